"""Calibrate a camera from a few shots: gamma, noise, black level, defects and colour, in one camera.json.

A SHOT is a DNG of Panchroma that shows a ColorChecker Classic whole, or (with --no-chart) an ordinary colourful scene; or a folder:
its DNGs are shots, those named dark* and flat* are dark and flat frames. A shot that cannot be used is skipped, with the reason.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from shared import Camera, Mosaic, read_dng
from shared.errors import InputError, OutputError, PanchromaError
from tools.host.console import Console
from tools.host.jobs import output_folder
from tools.host.versions import program_version


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma calibrate`."""
    parser.add_argument("shots", nargs="*", metavar="SHOT", help="a DNG with a ColorChecker in it, or a folder of DNGs")
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="camera.json to write")
    parser.add_argument(
        "--dark", nargs="+", default=[], metavar="F", help="frames with the lens covered: black level, read noise, defects"
    )
    parser.add_argument(
        "--flat", nargs="+", default=[], metavar="F", help="evenly lit frames, two at each exposure: gain, read noise"
    )
    parser.add_argument("--no-chart", action="store_true", help="the shots show ordinary scenes: measure gamma only")
    parser.add_argument(
        "--corners",
        nargs=4,
        metavar="X,Y",
        help="outer corners of the chart in a single shot, pixels: at dark skin, bluish green, black, white",
    )
    parser.add_argument("--reference", metavar="FILE", help="the chart's own colours: CGATS (.ti3, .cie) with XYZ or L*a*b* (D50)")
    parser.add_argument("--sensor", help="name of the sensor in FILE (default: the one in the shots)")
    parser.add_argument("--report", metavar="DIR", help="folder for report.html and chart.ti3 (Argyll CMS), created if missing")
    parser.add_argument("--update", action="store_true", help="replace only what is measured in FILE; FILE.bak keeps the old file")
    parser.add_argument("--overwrite", action="store_true", help="replace FILE and the report; FILE.bak keeps the old file")
    parser.add_argument("--json", action="store_true", help="print one JSON object per shot, then one for the result, to stdout")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Returns the exit code."""
    from tools.calibration.camera_file import updated, write_camera
    from tools.calibration.measure import Outcome, conclude, measure_chart, measure_scene
    from tools.calibration.noise import measure_dark, measure_flats
    from tools.calibration.reference import color_checker_xyz, read_reference, ti3
    from tools.calibration.report.page import report

    output = Path(arguments.output)
    shots, darks, flats = _sources(arguments)
    corners = _corners(arguments, shots)
    _check_output(output, arguments, (*shots, *darks, *flats))
    folder = None if arguments.report is None else output_folder(arguments.report)
    if folder is not None:
        _check_report(folder, overwrite=arguments.overwrite or arguments.update)
    reference = read_reference(Path(arguments.reference)) if arguments.reference else color_checker_xyz()
    work = _Work(console, arguments.sensor)

    dark_frames = work.each(darks, "dark", lambda name, mosaic: mosaic)
    dark = work.all(darks, lambda: measure_dark(dark_frames)) if dark_frames else None
    if dark is not None:
        work.black = tuple(dark.black.tolist())
        console.say(f"black level {_row(dark.black)} codes, read noise {_row(dark.read)} codes, {len(dark.defects)} defects")
    flat_frames = work.each(flats, "flat", lambda name, mosaic: mosaic)
    read = None
    if dark is not None and flat_frames:
        read = dark.read / (flat_frames[0].calibration.white_level - dark.black)
    flat = work.all(flats, lambda: measure_flats(flat_frames, read)) if flat_frames else None
    noise, dead, alone = flat if flat is not None else (None, [], [])
    for index in alone:
        console.note(f"flat frame {index + 1}: no partner of its exposure is left, or it is clipped; it is left out")

    def measure(name: str, mosaic: Mosaic) -> Any:
        with console.progress(name) as progress:
            shot = measure_scene(name, mosaic) if arguments.no_chart else measure_chart(name, mosaic, reference, corners, progress)
        where = f"chart at {_places(shot.chart.place.corners)}, " if shot.chart else ""
        console.say(f"{name}: {where}gamma {_row(shot.fits[0].gamma)} ± {_row(shot.fits[0].half_width)}")
        return shot

    measured = work.each(shots, "shot", measure)
    if work.base is None:
        console.error("nothing to calibrate from: every file was skipped, and no camera file was written")
        return 1
    if not measured and dark is None and noise is None:
        console.error("no shot could be used, and no camera file was written")
        return 1
    provenance = {"date": datetime.now(UTC).date().isoformat(), "program": f"panchroma {program_version()}"}
    outcome: Outcome = conclude(work.base, measured, reference, dark, noise, provenance, dead)
    for warning in outcome.warnings:
        console.note(f"warning: {warning}")
    if folder is not None:
        page = report(outcome, work.skipped, provenance)
        _write(folder / "report.html", page)
        if outcome.camera_rgb is not None and outcome.camera_rgb.shape[1] == 3:
            _write(folder / "chart.ti3", ti3(reference, outcome.camera_rgb))
        console.say(f"{folder / 'report.html'}: {outcome.verdict}")
    if outcome.camera is None:
        console.error(f"{outcome.refusal}; no camera file was written")
        console.record(source=str(output), ok=False, error=outcome.refusal)
        return 1
    camera, changes = updated(output, outcome.camera) if arguments.update and output.exists() else (outcome.camera, [])
    write_camera(output, camera, overwrite=arguments.update or arguments.overwrite)
    for line in changes:
        console.say(f"  {line}")
    console.say(f"{output}: {_summary(camera)}; {outcome.verdict}")
    console.record(
        source=str(output),
        ok=True,
        verdict=outcome.verdict,
        warnings=list(outcome.warnings),
        camera=camera.to_json(),
        id=camera.calibration.id,
    )
    return 1 if work.skipped else 0


class _Work:
    """Reads frames, holds them to be of one camera, and skips with one line what cannot be used."""

    def __init__(self, console: Console, sensor: str | None) -> None:
        self._console, self._sensor = console, sensor
        self.base: Mosaic | None = None
        self.black: tuple[float, ...] | None = None
        self.skipped: list[str] = []

    def each(self, paths: Sequence[str], kind: str, use: Callable[[str, Mosaic], Any]) -> list[Any]:
        """What `use` makes of each frame that can be used."""
        results = []
        for path in paths:
            try:
                mosaic = self._read(path)
                results.append(use(Path(path).name, mosaic))
            except (PanchromaError, MemoryError) as error:
                self._skip(path, str(error) or "not enough memory")
            else:
                self._console.record(source=path, ok=True, kind=kind)
        return results

    def all(self, paths: Sequence[str], use: Callable[[], Any]) -> Any:
        """What `use` makes of all frames together, or None with the reason told."""
        try:
            return use()
        except PanchromaError as error:
            self._skip(" ".join(paths), str(error))
            return None

    def _read(self, path: str) -> Mosaic:
        mosaic = read_dng(path)
        if self.base is not None:
            Camera(self.base.calibration, self.base.pattern).check(
                mosaic.pattern, replace(mosaic.calibration, sensor=self._sensor or mosaic.calibration.sensor)
            )
        calibration = replace(
            mosaic.calibration,
            sensor=self._sensor or mosaic.calibration.sensor,
            black_level=self.black or mosaic.calibration.black_level,
        )
        mosaic = Mosaic(mosaic.codes, mosaic.pattern, calibration, mosaic.metadata)
        self.base = self.base or mosaic
        return mosaic

    def _skip(self, path: str, reason: str) -> None:
        line = reason if path in reason else f"{path}: {reason}"
        self.skipped.append(line)
        self._console.error(f"skipped {line}")
        self._console.record(source=path, ok=False, error=" ".join(reason.split()))


def _sources(arguments: argparse.Namespace) -> tuple[list[str], list[str], list[str]]:
    """Shots, dark frames and flat frames, folders opened."""
    shots, darks, flats = [], list(arguments.dark), list(arguments.flat)
    for source in arguments.shots:
        if not Path(source).is_dir():
            shots.append(source)
            continue
        inside = sorted(path for path in Path(source).iterdir() if path.suffix.lower() == ".dng")
        if not inside:
            raise InputError(f"{source}: the folder has no DNG in it")
        for path in inside:
            name = path.name.lower()
            (darks if name.startswith("dark") else flats if name.startswith("flat") else shots).append(str(path))
    if not shots and not darks and not flats:
        raise InputError("nothing to calibrate from: name shots, or --dark and --flat frames")
    return shots, darks, flats


def _corners(arguments: argparse.Namespace, shots: Sequence[str]) -> tuple[tuple[float, float], ...] | None:
    if not arguments.corners:
        return None
    if len(shots) != 1 or arguments.no_chart:
        raise InputError(f"--corners tells where the chart is in one shot; {len(shots)} shots are given")
    try:
        return tuple((float(x), float(y)) for x, y in (corner.split(",") for corner in arguments.corners))
    except ValueError:
        raise InputError(f"--corners is {' '.join(arguments.corners)}, expected four X,Y in pixels") from None


def _check_output(output: Path, arguments: argparse.Namespace, inputs: Sequence[str]) -> None:
    """Refuse at once what would fail after the work is done."""
    if output.is_dir():
        raise OutputError(f"{output}: is a folder; -o names the camera file, for example {output / 'camera.json'}")
    if not output.parent.is_dir():
        raise OutputError(f"{output}: the folder {output.parent} does not exist; create it first")
    if output.exists() and any(Path(each).exists() and output.samefile(each) for each in inputs):
        raise OutputError(f"{output}: is an input; choose another name")
    if output.exists() and not (arguments.update or arguments.overwrite):
        raise OutputError(f"{output}: exists already; --update puts the new parts into it, --overwrite replaces it")


def _check_report(folder: Path, *, overwrite: bool) -> None:
    for name in ("report.html", "chart.ti3"):
        if (folder / name).exists() and not overwrite:
            raise OutputError(f"{folder / name}: exists already; use --overwrite to replace it")


def _write(path: Path, text: str) -> None:
    from shared.writing import write_durably

    write_durably(path, text.encode(), overwrite=True)


def _summary(camera: Camera) -> str:
    calibration = camera.calibration
    parts = ", ".join(camera.measured) or "nothing measured"
    gamma = _row(calibration.gamma)
    return f"{calibration.sensor or 'unnamed sensor'}, gamma {gamma}, measured: {parts}, id {calibration.id}"


def _row(values: Any) -> str:
    return " ".join(f"{value:.4g}" for value in values)


def _places(corners: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.0f},{y:.0f}" for x, y in corners)
