"""One run of `panchroma calibrate`: sort the files, read and measure them, and skip the frames that cannot be used."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from shared import Camera, Mosaic, SensorCalibration, read_dng
from shared.arrays import DoubleArray
from shared.colorimetry import Matrix
from shared.errors import InputError, OutputError, PanchromaError
from tools.host.console import Console
from tools.host.folders import DNGS, search
from tools.host.jobs import identity

from .aberration import AberrationResult, measure_aberration
from .assumed import Assumed
from .copies import DARK_ALIKE, FLAT_ALIKE, refuse_copies
from .dark_frames import DarkResult, measure_dark
from .edges import Edges, find_edges
from .measure import assumptions
from .noise import FlatResult, measure_flats, noise_of_flats
from .shading import ShadingResult, measure_shading
from .shot import ShotMeasurement, measure_chart, measure_scene

T = TypeVar("T")


@dataclass(frozen=True)
class CalibrationFiles:
    """The files to calibrate from: paths of shots, dark frames, flat frames, and shots with edges."""

    shots: tuple[str, ...]
    dark: tuple[str, ...]
    flat: tuple[str, ...]
    edges: tuple[str, ...]


def sort_files(
    sources: Sequence[str], dark: Sequence[str], flat: Sequence[str], edges: Sequence[str], console: Console
) -> CalibrationFiles:
    """Sort the given files by kind, and say what was left out of folders.

    sources: shots, and folders with DNGs in them or below. Of these, what is named dark*, flat* or edges*, or lies in a subfolder
        of such a name, is a dark or a flat frame or a shot with edges; the others are shots.
    dark, flat, edges: further dark and flat frames and shots with edges, and folders of them.

    Raises InputError if there is nothing to calibrate from, and for a folder that cannot be read or has no DNG.
    """
    files: dict[str, list[str]] = {"": [], "dark": [], "flat": [], "edges": []}
    for given, known in ((sources, ""), (dark, "dark"), (flat, "flat"), (edges, "edges")):
        found = search(given, DNGS)
        for folder, what in found.failures:
            raise InputError(f"{folder}: {what}")
        found.report(console)
        for source in found.sources:
            names = [part.lower() for part in reversed(source.below.parts)] if source.below and not known else []
            kinds = (kind for name in names for kind in files if kind and name.startswith(kind))
            files[next(kinds, known)].append(source.name)
    if not any(files.values()):
        raise InputError("nothing to calibrate from: name shots, or --dark, --flat and --edges frames")
    return CalibrationFiles(*map(tuple, files.values()))


def check_output(output: Path, files: CalibrationFiles, *, replace_existing: bool) -> None:
    """Raise OutputError if the camera file cannot be written to `output`. Call it before the measurements."""
    if output.is_dir():
        raise OutputError(f"{output}: is a folder; -o names the camera file, for example {output / 'camera.json'}")
    if not output.parent.is_dir():
        raise OutputError(f"{output}: the folder {output.parent} does not exist; create it first")
    if output.exists() and identity(output) in map(identity, (*files.shots, *files.dark, *files.flat, *files.edges)):
        raise OutputError(f"{output}: is an input; choose another name")
    if output.exists() and not replace_existing:
        raise OutputError(f"{output}: exists already; --update puts the new parts into it, --overwrite replaces it")


class Session:
    """Measures the frames of one camera. A frame that cannot be used is skipped, with a line that says why.

    console: for lines, records and progress.
    sensor: name of the sensor; None = the name in the frames.
    known: what a camera file knows of the camera; the frames get its shading. None = nothing.
    measured: parts of the camera before, as its file describes them; their black level and shading count as known.

    Attribute `base` is the first frame that was read, None if there is none; `skipped` has a line for each skipped frame. `shading`
    and `aberration` are what the flat frames, and the shots with edges, show of it, None if they were refused or there are none.
    `notes` has the reasons why flat frames tell no shading or no noise.
    """

    def __init__(
        self,
        console: Console,
        sensor: str | None,
        known: SensorCalibration | None = None,
        measured: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    ) -> None:
        self._console, self._sensor, self._known, self._measured = console, sensor, known, measured
        self._black = known.black_level if known and "black_level" in measured else None
        self._dark: DarkResult | None = None
        self.base: Mosaic | None = None
        self.skipped: list[str] = []
        self.shading: ShadingResult | None = None
        self.aberration: AberrationResult | None = None
        self.notes: list[str] = []

    def dark(self, paths: Sequence[str]) -> DarkResult | None:
        """Measure the dark frames; later frames get their black level. Returns None if there are none that can be used."""
        frames = self._each(paths, "dark", lambda path, mosaic: (path, _as_recorded(mosaic)))

        def measure() -> DarkResult:
            refuse_copies(frames, DARK_ALIKE)
            return measure_dark([mosaic for _, mosaic in frames])

        dark = self._together(paths, measure) if frames else None
        if dark is not None:
            self._black, self._dark = tuple(dark.black.tolist()), dark
            black, read, defects = figures(dark.black), figures(dark.read), len(dark.defects)
            shown = f"read noise {read} codes" if dark.shows_read else "read noise too small for these codes"
            self._console.say(f"black level {black} codes, {shown}, {defects} defects")
        return dark

    def flat(self, paths: Sequence[str], dark: DarkResult | None) -> FlatResult | None:
        """Measure the flat frames, their shading too; dark: what is known of dark frames.

        Returns None if there are none that can be used for noise. Later frames get the shading.
        """
        frames = self._each(paths, "flat", lambda path, mosaic: (path, _as_recorded(mosaic)))

        def differ() -> bool:
            refuse_copies(frames, FLAT_ALIKE)
            return True

        if not frames or not self._together(paths, differ):
            return None
        self._measure_shading(frames)
        try:
            flats, unpaired = measure_flats([mosaic for _, mosaic in frames])
            calibration = frames[0][1].calibration
            noise_of_flats(
                flats, calibration, dark, self._assumed(calibration).black
            )  # refused here, where the frames can be named
        except InputError as error:
            if self.shading is None:
                self._skip(" ".join(paths), str(error))
            else:
                self.notes.append(f"no noise was measured: {error}")
            return None
        for index in unpaired:
            self._console.note(f"{frames[index][0]} tells no noise: it is clipped, or no other flat frame has its exposure")
        return flats

    def _measure_shading(self, frames: Sequence[tuple[str, Mosaic]]) -> None:
        """Measure the shading of flat frames; what a shot says of its shading does not count any more."""
        calibration = self._known or frames[0][1].calibration
        try:
            self.shading = measure_shading(frames)
        except InputError as error:
            kept = ", and the one before is kept" if calibration.shading else ""
            self.notes.append(f"no shading was measured{kept}: {error}")
        else:
            calibration = replace(calibration, shading=self.shading.shading)
            self._console.say(self.shading.words)
        self._known = calibration
        if self.base is not None:
            self.base = replace(self.base, calibration=replace(self.base.calibration, shading=calibration.shading))

    def charts(self, paths: Sequence[str], reference: DoubleArray, corners: Matrix | None) -> list[ShotMeasurement]:
        """Measure shots of a chart; parameters: see `measure_chart`."""

        def measure(path: str, mosaic: Mosaic) -> ShotMeasurement:
            name = Path(path).name
            with self._console.progress(name) as progress:
                return self._announced(measure_chart(name, mosaic, reference, corners, progress, self._assumed(mosaic.calibration)))

        return self._each(paths, "shot", measure)

    def scenes(self, paths: Sequence[str]) -> list[ShotMeasurement]:
        """Measure shots of ordinary scenes."""

        def measure(path: str, mosaic: Mosaic) -> ShotMeasurement:
            return self._announced(measure_scene(Path(path).name, mosaic, self._assumed(mosaic.calibration)))

        return self._each(paths, "shot", measure)

    def _assumed(self, calibration: SensorCalibration) -> Assumed:
        return assumptions(calibration, self._dark, self._measured, even=self.shading is not None)

    def edges(self, paths: Sequence[str], gamma: DoubleArray | None) -> None:
        """Measure lateral chromatic aberration; what shots say of it does not count.

        gamma: of the camera, if it is known better than the shots say.
        """
        known: dict[bytes, str] = {}

        def look(path: str, mosaic: Mosaic) -> Edges:
            first = known.setdefault(hashlib.sha256(mosaic.codes.data).digest(), path)
            if first != path:
                raise InputError(f"it is the same shot as {first}")
            return find_edges(Path(path).name, mosaic, gamma)

        shots = self._each(list(dict.fromkeys(paths)), "edges", look)
        if paths and self.base is not None:
            self.base = replace(self.base, calibration=replace(self.base.calibration, aberration=None))
        if shots:
            self.aberration = self._together(paths, lambda: measure_aberration(shots))
        if self.aberration is not None:
            self._console.say(self.aberration.words)
        elif paths and self._known and self._known.aberration:
            self.notes.append("no chromatic aberration was measured, and the one before is kept")

    def _announced(self, shot: ShotMeasurement) -> ShotMeasurement:
        where = f"chart at {shot.chart.place}, " if shot.chart else ""
        self._console.say(f"{shot.name}: {where}gamma {figures(shot.fits[0].gamma)} ± {figures(shot.fits[0].half_width)}")
        return shot

    def _each(self, paths: Sequence[str], kind: str, measure: Callable[[str, Mosaic], T]) -> list[T]:
        """Return the results of `measure(path, mosaic)` for all frames that can be used."""
        results = []
        for path in paths:
            try:
                mosaic = self._read(path)
                shading = mosaic.calibration.shading
                if kind == "shot" and shading and (zoomed := shading.zoomed(mosaic.metadata.focal_length)):
                    self._console.note(f"{path}: {zoomed}")
                results.append(measure(path, mosaic))
            except (PanchromaError, MemoryError) as error:
                self._skip(path, str(error) or "not enough memory")
            else:
                self._console.record(source=path, ok=True, kind=kind)
        return results

    def _together(self, paths: Sequence[str], measure: Callable[[], T]) -> T | None:
        """Return the result of `measure()`, which uses all these frames; None, with a line that says why, if it fails."""
        try:
            return measure()
        except PanchromaError as error:
            self._skip(" ".join(paths), str(error))
            return None

    def _read(self, path: str) -> Mosaic:
        """Read a frame. Raises InputError if it is from another camera than the frames before."""
        mosaic = read_dng(path)
        # What one frame's colours suggest of the light is no part of a camera.
        calibration = replace(mosaic.calibration.without_estimates(), sensor=self._sensor or mosaic.calibration.sensor)
        if self.base is not None:
            Camera(self.base.calibration, self.base.pattern).check(mosaic.pattern, calibration)
        shading = self._known.shading if self._known else calibration.shading
        calibration = replace(calibration, black_level=self._black or calibration.black_level, shading=shading)
        mosaic = Mosaic(mosaic.codes, mosaic.pattern, calibration, mosaic.metadata)
        self.base = self.base or mosaic
        return mosaic

    def _skip(self, path: str, reason: str) -> None:
        line = reason if path in reason else f"{path}: {reason}"
        self.skipped.append(line)
        self._console.error(f"skipped {line}")
        self._console.record(source=path, ok=False, error=" ".join(reason.split()))


def _as_recorded(mosaic: Mosaic) -> Mosaic:
    """Return a frame whose calibration has no shading."""
    return replace(mosaic, calibration=replace(mosaic.calibration, shading=None))


def figures(values: Sequence[float] | DoubleArray) -> str:
    """Return numbers as text, with four digits each."""
    return " ".join(f"{value:.4g}" for value in values)
