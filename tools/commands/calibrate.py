"""Calibrate a camera from a few shots: gamma, noise, black level, defects, colour, shading and chromatic aberration.

A SHOT is a DNG of Panchroma that shows a whole ColorChecker Classic, or (with --no-chart) an ordinary colourful scene. It can also
be a folder with DNGs in it or below: what is named dark*, flat* or edges*, or lies in a subfolder of such a name, is a dark or a
flat frame or a shot for --edges, the others are shots. A shot that cannot be used is skipped, with the reason. All is kept in one
camera.json.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shared import Camera, Mosaic
from shared.arrays import DoubleArray
from shared.colorimetry import Matrix
from shared.errors import InputError
from shared.writing import write_durably
from tools.host.console import Console
from tools.host.jobs import FAILED, output_folder, refuse_existing
from tools.host.versions import program_version
from tools.pictures.html import encode_page

from .options import add, numbers, text

if TYPE_CHECKING:
    from tools.calibration.shot import ShotMeasurement


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma calibrate`."""
    parser.add_argument(
        "shots", nargs="*", metavar="SHOT", help="DNG of Panchroma with a ColorChecker, or a folder with DNGs in it or below"
    )
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="camera.json to write")
    parser.add_argument(
        "--dark", nargs="+", metavar="F", help="frames (or folders of them) with the lens covered: black level, read noise, defects"
    )
    parser.add_argument(
        "--flat",
        nargs="+",
        metavar="F",
        help="evenly lit frames (or folders of them): shading; two of each exposure: gain, read noise",
    )
    parser.add_argument(
        "--edges",
        nargs="+",
        metavar="F",
        help="shots with many sharp edges all over the frame (or folders of them), a chart or ordinary ones: lateral chromatic "
        "aberration",
    )
    parser.add_argument("--no-chart", action="store_true", help="the shots are ordinary scenes: measure only gamma")
    parser.add_argument(
        "--corners",
        nargs=4,
        type=numbers(2, "12,34.5"),
        metavar="X,Y",
        help="outer corners of the chart in the only shot, in pixels: at dark skin, bluish green, black, white",
    )
    parser.add_argument("--chart", metavar="FILE", help="colours of your chart: CGATS file (.ti3, .cie) with XYZ or L*a*b* (D50)")
    parser.add_argument("--sensor", type=text, metavar="NAME", help="name of the sensor (default: the name in the shots)")
    parser.add_argument("--report", metavar="DIR", help="folder for report.html, and chart.ti3 for Argyll CMS; created if missing")
    parser.add_argument(
        "--update",
        action="store_true",
        help="add these frames to FILE: what is better known replaces what is less known; FILE.bak keeps the old file",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace FILE and the report; FILE.bak keeps the old file")
    add(parser, "json", each="shot, then one for the result,")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Calibrate the camera. Returns 0, or 1 if a frame was skipped or no camera file was written."""
    from tools.calibration.camera_file import check_same, difference, merged, read_known, unsupported, write_camera
    from tools.calibration.measure import conclude
    from tools.calibration.observations import Observations
    from tools.calibration.reference import color_checker_xyz, read_reference, ti3
    from tools.calibration.report.page import report
    from tools.calibration.session import Session, check_output, sort_files

    output, replace_existing = Path(arguments.output), arguments.update or arguments.overwrite
    files = sort_files(arguments.shots, arguments.dark or (), arguments.flat or (), arguments.edges or (), console)
    corners = _corners(arguments, len(files.shots))
    check_output(output, files, replace_existing=replace_existing)
    folder = None if arguments.report is None else output_folder(arguments.report)
    if folder is not None and not replace_existing:
        refuse_existing((folder / "report.html", folder / "chart.ti3"))
    reference = read_reference(Path(arguments.chart)) if arguments.chart else color_checker_xyz()
    old, known = read_known(output) if arguments.update and output.exists() else (None, Observations())

    session = Session(console, arguments.sensor, old.calibration if old else None, old.measured if old else {})
    dark = session.dark(files.dark)
    flats = session.flat(files.flat, dark or known.dark)
    shots = session.scenes(files.shots) if arguments.no_chart else session.charts(files.shots, reference, corners)
    session.edges(files.edges, _gamma(shots, old))
    if session.base is None or not (shots or dark or flats or session.shading or session.aberration):
        for note in session.notes:
            console.note(note)
        console.error("no frame could be used, and no camera file was written")
        return FAILED
    if files.shots and not shots and not (old and "gamma" in old.measured):
        error = (
            f"gamma is not known, for no {'scene' if arguments.no_chart else 'chart'} could be used, and no camera file was written"
        )
        remedy = "shoot it anew, or leave these shots out to keep only what the other frames show"
        console.error(f"{error}; {remedy}")
        console.record(source=str(output), ok=False, error=f"{error}; {remedy}")
        return FAILED
    base, notes, fixed = session.base, session.notes, []
    if old is not None:
        check_same(output, old, base)
        base = Mosaic(base.codes, base.pattern, replace(old.calibration, sensor=old.calibration.sensor or base.calibration.sensor))
        if fixed := unsupported(old, known):
            notes = [*notes, f"{output} does not keep what its {', '.join(fixed)} came from: these are not judged anew"]
    charts = () if arguments.no_chart else tuple(shots)
    seen, lines = Observations(dark, flats, charts, tuple(shots[len(charts) :])).with_known(known)
    for line in lines:
        console.note(line)
    provenance = {"date": datetime.now(UTC).date().isoformat(), "program": f"panchroma {program_version()}"}
    outcome = conclude(base, seen, reference, provenance, notes, session.shading, session.aberration, old)

    for contradiction in outcome.contradictions:
        console.error(contradiction)
    for warning in outcome.warnings:
        console.note(f"warning: {warning}")
    if folder is not None:
        page = report(outcome, session.skipped, provenance)
        write_durably(folder / "report.html", encode_page(page), overwrite=True)
        if outcome.camera_rgb is not None and outcome.camera_rgb.shape[1] == 3:
            write_durably(folder / "chart.ti3", ti3(reference, outcome.camera_rgb).encode(), overwrite=True)
        console.say(f"{folder / 'report.html'}: {outcome.verdict}")
    if outcome.camera is None:
        said = outcome.contradictions and outcome.refusal == "; ".join(outcome.contradictions)
        console.error(
            "no camera file was written; do not use these shots" if said else f"{outcome.refusal}; no camera file was written"
        )
        console.record(source=str(output), ok=False, error=outcome.refusal, verdict=outcome.verdict)
        return FAILED
    camera = outcome.camera if old is None else merged(old, outcome.camera, fixed)
    kept = write_camera(output, camera, overwrite=replace_existing)
    for line in difference(old, camera) if old is not None else ():
        console.say(f"  {line}")
    if kept is not None:
        console.say(f"{kept}: the file as it was before")
    console.say(f"{output}: {_summary(camera)}; {outcome.verdict}")
    warnings, identity = [*outcome.contradictions, *outcome.warnings], camera.calibration.id
    console.record(source=str(output), ok=True, verdict=outcome.verdict, warnings=warnings, camera=camera.to_json(), id=identity)
    return FAILED if session.skipped else 0


def _corners(arguments: argparse.Namespace, shots: int) -> Matrix | None:
    if not arguments.corners:
        return None
    if shots != 1 or arguments.no_chart:
        raise InputError(f"--corners gives the place of the chart in one shot; {shots} shots are given")
    return tuple(arguments.corners)


def _gamma(shots: "Sequence[ShotMeasurement]", old: Camera | None) -> DoubleArray | None:
    """Return gamma as these shots show it, or else as a camera file has it; None if it is not known."""
    from tools.calibration.gamma import combined

    if shots:
        return combined([fit for shot in shots for fit in shot.fits]).gamma
    return np.array(old.calibration.gamma) if old and "gamma" in old.measured else None


def _summary(camera: Camera) -> str:
    from tools.calibration.session import figures

    name, parts = camera.calibration.sensor or "unnamed sensor", ", ".join(camera.measured) or "nothing measured"
    return f"{name}, gamma {figures(camera.calibration.gamma)}, measured: {parts}, id {camera.calibration.id}"
