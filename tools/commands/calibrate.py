"""Calibrate a camera from a few shots: gamma, noise, black level, defects, colour and shading.

A SHOT is a DNG of Panchroma that shows a whole ColorChecker Classic. It can also be a folder with
DNGs in it or below: what is named dark* or flat*, or lies in a subfolder of such a name, is a dark
or a flat frame, the others are shots. --dark and --flat take one file or folder each, and are
repeated for more. A shot that cannot be used is skipped, with the reason. All is kept in one
camera.json.
"""

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...shared import Camera, read_dng
from ...shared.colorimetry import Matrix
from ..batch.console import Console
from ..batch.jobs import FAILED, output_folder, refuse_existing, write_report
from .options import add, numbers, pixel_limit, text, value

if TYPE_CHECKING:
    from ..calibration.conclude import Result

USAGE = "[SHOT ...] -o FILE"
EXAMPLE = "panchroma calibrate chart.dng --dark darks --flat flats -o camera.json --report report"


def _named_light(text: str) -> tuple[str, str]:
    light, path = text.split("=", 1)
    return light.upper().removesuffix("K"), path


_light = value(_named_light, "a light and a file or folder, such as D65=charts", all)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma calibrate`."""
    shots = "DNG of Panchroma with a ColorChecker, or a folder with DNGs in it or below"
    parser.add_argument("shots", metavar="SHOT", nargs="*", help=shots)
    add(parser, "output", metavar="FILE", help="camera.json to write")
    repeated: dict[str, Any] = {"action": "append", "default": []}
    more = "; or a folder of them; repeat it for more"
    dark = f"a frame with the lens covered: black level, read noise, defects{more}"
    parser.add_argument("--dark", metavar="F", **repeated, help=dark)
    flat = f"an evenly lit frame: shading; two of each exposure: gain, read noise{more}"
    parser.add_argument("--flat", metavar="F", **repeated, help=flat)
    light = (
        "in place of SHOT: a light (A, D50, D55, D65, D75, or kelvin such as 3200) and a shot of "
        "the chart under it, or a folder of them; repeat it for more, two lights in all; pictures "
        "under any light between the two then have the right colours; with --update one of the "
        "two in FILE is enough, and the other stays"
    )
    parser.add_argument("--chart-light", metavar="LIGHT=F", type=_light, **repeated, help=light)
    at = "at dark skin, bluish green, black, white"
    corners = f"outer corners of the chart in the only shot, in pixels: {at}"
    place = numbers(2, "12,34.5")
    parser.add_argument("--corners", metavar="X,Y", nargs=4, type=place, help=corners)
    colours = "colours of your chart: CGATS file (.ti3, .cie) with XYZ or L*a*b* (D50)"
    parser.add_argument("--chart", metavar="FILE", help=colours)
    sensor = "name of the sensor (default: the name in the shots)"
    parser.add_argument("--sensor", metavar="NAME", type=text, help=sensor)
    report = "folder for report.html, created if missing"
    parser.add_argument("--report", metavar="DIR", help=report)
    old = "FILE.bak keeps the old file"
    noise = "noise that moves beyond its intervals takes --overwrite as well"
    update = f"replace only those parts of FILE that these frames measure; {old}; {noise}"
    parser.add_argument("--update", action="store_true", help=update)
    add(parser, "overwrite", help=f"replace FILE and the report; {old}")
    add(parser, "json")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Calibrate the camera.

    Returns
    -------
    int
        0, or 1 if a frame was skipped or no camera file was written.
    """
    from ..calibration.calibrated import NoCameraError, calibrated, shots_by_light
    from ..calibration.conclude import noise_change
    from ..calibration.files import KINDS, check_output, read_known, sort_files
    from ..calibration.measure import Measurements, Session
    from ..calibration.reference import read_reference
    from ..calibration.report import build_report

    output, replace_existing = Path(arguments.output), arguments.update or arguments.overwrite
    old = read_known(output) if arguments.update and output.is_file() else None
    lights = shots_by_light(arguments.chart_light, old)
    files, searches = sort_files({kind: getattr(arguments, kind) for kind in KINDS} | lights)
    for search in searches:
        search.report(console)
    corners: Matrix | None = arguments.corners and tuple(arguments.corners)
    check_output(output, files, replace_existing=replace_existing)
    page = None if arguments.report is None else output_folder(arguments.report) / "report.html"
    if page and not replace_existing:
        refuse_existing((page,))
    measured = Measurements(read_reference(arguments.chart), old=old)
    try:
        read = partial(read_dng, max_pixels=pixel_limit())
        session = Session(console, measured, arguments.sensor, read)
        result = calibrated(session, files, corners, str(output))
    except NoCameraError as error:
        return _refuse(output, str(error), console)
    if result.camera:  # otherwise they are the reason
        console.error(*result.contradictions)
    console.note(*(f"warning: {line}" for line in result.warnings))
    if old is not None and result.camera is not None:
        change, beyond = noise_change(old, result.camera)
        if beyond and not arguments.overwrite:
            remedy = "more than both intervals allow; if it is right, add --overwrite"
            return _refuse(output, f"{output}: {change}, {remedy}", console)
        if change:
            console.say(change)
    code = _write(output, result, old, console, replace_existing)
    if page:
        if not write_report(page, partial(build_report, result), console, overwrite=True):
            return FAILED
        console.say(f"{page}: {result.words}")
    return code


def _refuse(output: Path, error: str, console: Console, **facts: Any) -> int:
    """Say and record why no camera file was written."""
    console.error(error)
    console.record(source=str(output), ok=False, error=error, **facts)
    return FAILED


def _write(
    output: Path, result: "Result", old: Camera | None, console: Console, overwrite: bool
) -> int:
    """Write the camera file, and say what it holds; returns the exit code."""
    from ..calibration.files import write_camera
    from ..calibration.places import figures

    camera, verdict = result.camera, result.verdict
    if camera is None:
        error = f"{result.refusal}; no camera file was written"
        return _refuse(output, error, console, verdict=verdict, facts=result.facts)
    if (kept := write_camera(output, camera, overwrite=overwrite)) is not None:
        console.say(f"{kept}: the file as it was before")
    if old is not None:
        new = list(result.facts)
        same = ", ".join(entry for entry in old.measured if entry not in new) or "nothing"
        console.say(f"measured now: {', '.join(new) or 'nothing'}; kept as it was: {same}")
    calibration, entries = camera.calibration, ", ".join(camera.measured) or "nothing measured"
    sensor, gamma = calibration.sensor or "unnamed sensor", figures(calibration.gamma)
    described = f"{sensor}, gamma {gamma}, measured: {entries}, id {calibration.id}"
    console.say(f"{output}: {described}; {result.words}")
    warnings = map(console.spell, (*result.contradictions, *result.warnings))
    facts = {"verdict": verdict, "warnings": [*warnings]}
    console.record(source=str(output), ok=True, **facts, camera=camera.to_json(), id=calibration.id)
    return FAILED if result.measured.skipped else 0
