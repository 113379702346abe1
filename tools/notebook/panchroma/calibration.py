"""Calibrating a camera from its shots."""

from __future__ import annotations  # help() then shows them as they are written here

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .pictures import checked_flag
from .shared import Camera, InputError
from .shared.reading import MAX_PIXELS, File, file_name
from .shared.writing import write_durably
from .shots import Shot, Shots, named_shots, reader
from .tools.batch.console import Console
from .tools.batch.in_memory import note_once
from .tools.batch.jobs import output_folder, refuse_existing
from .tools.calibration.calibrated import NoCameraError, calibrated, shots_by_light
from .tools.calibration.conclude import Result, noise_change
from .tools.calibration.files import KINDS, read_known, sort_files, write_camera
from .tools.calibration.measure import Measurements, Session
from .tools.calibration.reference import read_reference


@dataclass(frozen=True, eq=False, repr=False, match_args=False)
class Calibration:
    """A camera that was measured, and how well it is known.

    Attributes
    ----------
    camera : Camera
        The camera; `camera.calibration` has gamma, noise, levels and colours, `camera.measured`
        how each of them was measured.
    verdict : str
        "use it", "use it with care" or "do not use it".
    warnings : tuple[str, ...]
        What a user has to know of it; what is wrong beyond doubt comes first.
    skipped : tuple[str, ...]
        A line for each frame that could not be used.

    Examples
    --------
    >>> import panchroma
    >>> darks = [panchroma.simulate("dark:96x72", light=1, rng=seed) for seed in (1, 2)]
    >>> found = panchroma.calibrate(dark=darks)
    >>> found.verdict, [round(level) for level in found.camera.calibration.black_level]
    ('use it with care', [256, 256, 256, 256])
    >>> found.facts["black_level"]["frames"]
    2
    """

    camera: Camera
    verdict: str
    warnings: tuple[str, ...]
    skipped: tuple[str, ...]
    _result: Result

    @property
    def facts(self) -> Mapping[str, Mapping[str, Any]]:
        """Facts of each part that these frames show, "gamma", "noise" ...: how it was measured.
        Those of an updated camera that stayed are in `camera.measured` alone.
        """
        return self._result.facts

    def save(
        self, path: File, *, report: str | Path | None = None, overwrite: bool = False
    ) -> None:
        """Write the camera as a file that `open`, `simulate` and `burst` take as `camera`.

        Parameters
        ----------
        report : str | Path | None, optional
            Folder for report.html, a page with the measurements and how well they fit; created if
            missing.
        overwrite : bool, optional
            Replace existing files; FILE.bak keeps the old camera file.
        """
        page = None if report is None else output_folder(str(report)) / "report.html"
        if page and not checked_flag(overwrite):
            refuse_existing((page,))
        write_camera(path, self.camera, overwrite=checked_flag(overwrite))
        if page:
            from .tools.calibration.report import build_report

            write_durably(page, build_report(self._result), overwrite=overwrite)

    def __repr__(self) -> str:
        return f"<Calibration: {self._result.words}>"


class _Log(Console):
    """Remarks and errors are logged; results are what `calibrate` returns."""

    def __init__(self) -> None:
        super().__init__(quiet=True)
        self.errors: list[str] = []

    def say(self, *lines: str) -> None:
        pass

    def note(self, *texts: str) -> None:
        for text in texts:
            note_once(text)

    def error(self, *texts: str, cause: BaseException | None = None) -> None:
        self.errors += texts
        self.note(*texts)


def calibrate(
    shots: Shots = (),
    *,
    dark: Shots = (),
    flat: Shots = (),
    chart_light: Mapping[str, Shots] | None = None,
    corners: Sequence[tuple[float, float]] | None = None,
    chart: File | None = None,
    sensor: str | None = None,
    update: File | None = None,
    max_pixels: int = MAX_PIXELS,
) -> Calibration:
    """Measure a camera: gamma, noise, black level, defects, colour and shading, as far as the
    frames show them.

    A frame that cannot be used is skipped, which is logged.

    Parameters
    ----------
    shots : Shots, optional
        Shots of a whole ColorChecker Classic: a `Shot`, its file, the name of a folder with them,
        or a list of these. In a folder, what is named dark* or flat*, or lies in a subfolder of
        such a name, is a dark or a flat frame.
    dark : Shots, optional
        Frames with the lens covered: black level, read noise, defects.
    flat : Shots, optional
        Evenly lit frames: shading; two of each exposure: gain, read noise.
    chart_light : Mapping[str, Shots] | None, optional
        In place of `shots`: those under each of two lights (A, D50, D55, D65, D75, or kelvin such
        as "3200"). Pictures under any light between the two then have the right colours. With
        `update` one of the two that the file has is enough.
    corners : Sequence[tuple[float, float]] | None, optional
        Outer corners (x, y) of the chart in the only shot, in pixels: at dark skin, bluish green,
        black, white. None = find them.
    chart : File | None, optional
        A CGATS file (.ti3, .cie) with the colours of the chart, XYZ or L*a*b* (D50). None = those
        of a usual one.
    sensor : str | None, optional
        Name of the sensor. None = the name in the shots.
    update : File | None, optional
        A camera.json, of which only those parts are replaced that these frames measure.
    max_pixels : int, optional
        A larger frame is skipped.

    Raises
    ------
    PanchromaError
        Where the frames do not show enough, or contradict each other.

    Examples
    --------
    >>> import panchroma
    >>> chart = panchroma.simulate("chart:480x320", light=1)
    >>> darks = [panchroma.simulate("dark:480x320", light=1, rng=seed) for seed in (1, 2)]
    >>> found = panchroma.calibrate(chart, dark=darks)
    >>> found.verdict, sorted(found.facts)
    ('use it with care', ['black_level', 'colour', 'defects', 'gamma'])
    >>> found.save("camera.json")
    >>> panchroma.simulate("builtin:120x90", camera="camera.json").shape
    (90, 120)
    """
    console = _Log()
    try:
        place = None if corners is None else tuple((float(x), float(y)) for x, y in corners)
    except (TypeError, ValueError):
        place = ()
    if place is not None and len(place) != 4:
        raise InputError(f"`corners` is {corners!r}, expected four (x, y)")
    old = None if update is None else read_known(update)
    kinds: dict[str, Shots] = dict(zip(KINDS, (shots, dark, flat), strict=True))
    lights = {str(light).upper().removesuffix("K"): on for light, on in (chart_light or {}).items()}
    requested: dict[str, list[str]] = {}
    held: dict[str, Shot] = {}
    for kind, frames in (kinds | lights).items():
        requested[kind], shots_held = named_shots(frames, kind)
        held |= shots_held
    by_light = [(light, name) for light in lights for name in requested.pop(light)]
    files, searches = sort_files(requested | shots_by_light(by_light, old))
    for search in searches:
        console.note(*search.left_out)
    measured = Measurements(read_reference(chart), old=old)
    session = Session(console, measured, sensor, reader(held, max_pixels))
    try:
        result = calibrated(session, files, place, file_name(update or ""))
    except NoCameraError as error:
        raise InputError("; ".join((str(error), *console.errors))) from None
    if result.camera is None:
        raise InputError(result.refusal)
    warnings = (*result.contradictions, *result.warnings)
    if old is not None and (moved := noise_change(old, result.camera))[1]:
        warnings += (f"{moved[0]}, more than both intervals allow",)
    console.note(*warnings)
    skipped = tuple(result.measured.skipped)
    return Calibration(result.camera, result.verdict, warnings, skipped, result)
