"""From the frames of one camera to its camera file: what the command and Python do alike."""

from collections.abc import Iterable
from datetime import UTC, datetime

from ...shared import Camera, InputError
from ...shared.colorimetry import Matrix
from ...shared.lights import check_apart, illuminant_xy
from ..io.versions import program_version
from .conclude import Result, conclude
from .files import KINDS, Files, check_same
from .measure import Session


class NoCameraError(InputError):
    """The frames do not show what a camera file needs."""


def shots_by_light(named: Iterable[tuple[str, str]], old: Camera | None) -> dict[str, list[str]]:
    """The shots of the chart under each of two lights, or one that the file `old` has; empty if
    there is one, which needs no name.

    named: (light, file or folder). Raises InputError for other lights.
    """
    shots: dict[str, list[str]] = {}
    for light, path in named:
        illuminant_xy(light)
        shots.setdefault(light, []).append(path)
    known = [light.illuminant for light in (old and old.calibration.lights) or ()]
    if len(shots) not in (0, 2) and not (len(shots) == 1 and shots.keys() <= {*known}):
        one = f"one of two that the camera file has ({' and '.join(known) or 'it has none'})"
        two = "two lights, such as A and D65, with shots of the chart under each"
        both = f"`chart_light` names {two}, or, with `update`, {one}"
        raise InputError(f"{both}; charts under one light need none")
    if len(shots) > 1:
        check_apart(*shots)
    return shots


def calibrated(session: Session, files: Files, corners: Matrix | None, output: str) -> Result:
    """Measure the frames, see `Session.measure`, and conclude what camera they are from.

    output: the name of the old camera file, for messages.

    Raises InputError if there are no frames, or several shots for the corners of one chart, for
    frames of another camera than the old one, and NoCameraError where they do not show enough.
    """
    if not any(files.values()):
        raise InputError("nothing to calibrate from: name shots, or `dark` and `flat` frames")
    if corners and len(files["shots"]) != 1:
        number = f"{len(files['shots'])} shots are given"
        raise InputError(f"`corners` gives the place of the chart in one shot; {number}")
    measurements = session.measure(files, corners)
    if (old := measurements.old) is not None and measurements.base is not None:
        check_same(output, old, measurements.base)
    facts = measurements.dark, measurements.flats, measurements.shots, measurements.shading
    if measurements.base is None or not any(facts):
        session.console.note(*measurements.remarks)
        raise NoCameraError("no frame could be used, and no camera file was written")
    is_known = bool(measurements.shots) or (old is not None and "gamma" in old.measured)
    if any(names for kind, names in files.items() if kind not in KINDS[1:]) and not is_known:
        fault = "gamma is not known, for no chart could be used, and no camera file was written"
        remedy = "leave these shots out to keep only what the other frames show"
        raise NoCameraError(f"{fault}; mend what is said above, or {remedy}")
    made = {"date": datetime.now(UTC).date().isoformat()}
    return conclude(measurements, made | {"program": f"panchroma {program_version()}"})
