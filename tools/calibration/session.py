"""Read and measure the frames of one camera, in the order in which one kind needs what another has shown."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from shared import Camera, Mosaic, SensorCalibration, read_dng
from shared.arrays import DoubleArray
from shared.colorimetry import Matrix
from shared.errors import InputError, PanchromaError
from tools.host.console import Console
from tools.host.jobs import reason
from tools.host.progress import StageProgress
from tools.host.work import Here, Workers, follow

from .aberration import measure_aberration
from .dark_frames import measure_dark
from .edges import Edges, Filled, find_edges
from .files import KINDS, Files
from .frame_sets import DARK_ALIKE, FLAT_ALIKE, refuse_copies
from .gamma import Assumed
from .noise import measure_flats, noise_of_flats
from .observations import Observations, ShotMeasurement, measure_chart
from .samples import without
from .shading import measure_shading

Frames = list[tuple[str, Mosaic]]
R = TypeVar("R")


class Session:
    """Measures the frames of one camera. A frame that cannot be used is skipped, with a line that says why.

    console: for lines, records and progress.
    sensor: name of the sensor; None = the name in the frames.
    old: a camera file that is updated: its black level, shading and gamma count as known. None = there is none.
    read: reads a frame.

    Attribute `seen` is what was measured so far.
    """

    def __init__(
        self,
        console: Console,
        sensor: str | None = None,
        old: Camera | None = None,
        read: Callable[[str], Mosaic] = read_dng,
    ) -> None:
        self._console, self._sensor, self._old, self._read_file = console, sensor, old, read
        self._known: dict[str, Any] = {}  # fields of the calibration that count more than what a frame states
        if old:
            self._known["shading"] = old.calibration.shading
            if "black_level" in old.measured:
                self._known["black_level"] = old.calibration.black_level
        self.seen = Observations()

    def measure(self, files: Files, chart_colours: DoubleArray, corners: Matrix | None, filled: Filled) -> Observations:
        """Measure all frames; chart_colours, corners: see `shots`; filled: see `find_edges`."""
        self.dark(files["dark"])
        self.flat(files["flat"])
        self.shots(files["shots"], chart_colours, corners)
        self.seen.lights = tuple(kind for kind in files if kind not in KINDS)
        for light in self.seen.lights:
            self.shots(files[light], chart_colours, light=light)
        self.edges(files["edges"], filled)
        return self.seen

    def dark(self, paths: Sequence[str]) -> None:
        """Measure the dark frames; later frames get their black level."""
        if frames := self._unshaded(paths, "dark"):
            with self._skipping(paths):
                refuse_copies(frames, DARK_ALIKE)
                self.seen.dark = measure_dark([mosaic for _, mosaic in frames])
                self._known["black_level"] = tuple(self.seen.dark.black.tolist())
                self._console.say(self.seen.dark.words)

    def flat(self, paths: Sequence[str]) -> None:
        """Measure the flat frames; later frames get their shading."""
        if frames := self._unshaded(paths, "flat"):
            with self._skipping(paths):
                refuse_copies(frames, FLAT_ALIKE)
                self._measure_shading(frames)
                self._measure_noise(paths, frames)

    def _measure_shading(self, frames: Frames) -> None:
        """Measure the shading of flat frames; what a shot states of its shading does not count any more."""
        self._forget("shading")
        before = self._known.setdefault("shading", None)
        try:
            self.seen.shading = measure_shading(frames)
        except InputError as error:
            self.seen.remarks.append(f"no shading was measured{', and the one before is kept' if before else ''}: {error}")
        else:
            self._known["shading"] = self.seen.shading.shading
            self._console.say(self.seen.shading.words)

    def _measure_noise(self, paths: Sequence[str], frames: Frames) -> None:
        """Measure the noise of flat frames, which only pairs of them show."""
        try:
            flats, unpaired = measure_flats([mosaic for _, mosaic in frames])
            calibration = frames[0][1].calibration
            # Frames that do not show it are refused here, where they can be named.
            noise_of_flats(flats, calibration, self.seen.dark, self._assumed(calibration).black)
        except InputError as error:
            if self.seen.shading is None:
                raise
            self.seen.remarks.append(f"no noise was measured: {error}")
            return
        self.seen.flats = flats
        for index in unpaired:
            self._console.note(f"{frames[index][0]} tells no noise: it is clipped, or no other flat frame has its exposure")

    def shots(self, paths: Sequence[str], chart_colours: DoubleArray, corners: Matrix | None = None, light: str = "") -> None:
        """Measure shots of a chart.

        chart_colours: (24, 3), XYZ (D50), white = 1.
        corners: where the chart is, see `ChartPlace`; None = find it.
        light: see `ShotMeasurement`.
        """

        def measured(path: str, progress: StageProgress) -> ShotMeasurement:
            mosaic, name = self._read(path), Path(path).name
            if (shading := mosaic.calibration.shading) and (zoomed := shading.zoomed(mosaic.metadata.focal_length)):
                self._console.note(f"{path}: {zoomed}")
            return measure_chart(name, mosaic, chart_colours, corners, progress, self._assumed(mosaic.calibration))

        for shot in self._each(paths, "shot", measured):
            self._console.say(shot.words)
            self.seen.shots.append(replace(shot, light=light))

    def edges(self, paths: Sequence[str], filled: Filled) -> None:
        """Measure lateral chromatic aberration; what shots state of it does not count."""
        if not paths:
            return
        known: dict[bytes, str] = {}
        before = np.array(self._old.calibration.gamma) if self._old and "gamma" in self._old.measured else None
        gamma = fit.gamma if (fit := self.seen.gamma) else before

        def found(path: str, _: StageProgress) -> Edges:
            mosaic = self._read(path)
            first = known.setdefault(hashlib.sha256(mosaic.codes.data).digest(), path)
            if first != path:
                raise InputError(f"it is the same shot as {first}")
            return find_edges(Path(path).name, mosaic, filled, gamma)

        shots = list(self._each(list(dict.fromkeys(paths)), "edges", found))
        self._forget("aberration")
        with self._skipping(paths):
            if shots:
                self.seen.aberration = measure_aberration(shots)
                self._console.say(self.seen.aberration.words)
        if self.seen.aberration is None and self._old and self._old.calibration.aberration:
            self.seen.remarks.append("no chromatic aberration was measured, and the one before is kept")

    def _assumed(self, calibration: SensorCalibration) -> Assumed:
        measured = self._old.measured if self._old else {}
        return Assumed.of(calibration, self.seen.dark, measured, even=self.seen.shading is not None)

    def _unshaded(self, paths: Sequence[str], kind: str) -> Frames:
        """Return the frames that can be read, without the shading that they state."""
        return list(self._each(paths, kind, lambda path, _: (path, without(self._read(path), "shading"))))

    def _read(self, path: str) -> Mosaic:
        """Read a frame, and correct what it states. Raises InputError if it is from another camera than the frames before."""
        mosaic = self._read_file(path)
        # What one frame's colours suggest of the light is no part of a camera.
        calibration = replace(mosaic.calibration.without_estimates(), sensor=self._sensor or mosaic.calibration.sensor)
        if self.seen.base is not None:
            Camera(self.seen.base.calibration, self.seen.base.pattern).check(mosaic.pattern, calibration)
        mosaic = Mosaic(mosaic.codes, mosaic.pattern, replace(calibration, **self._known), mosaic.metadata)
        if self.seen.base is None:
            self.seen.base = mosaic
        return mosaic

    def _forget(self, part: str) -> None:
        """Leave out what the first frame states of its lens, because these frames measure it."""
        if self.seen.base is not None:
            self.seen.base = without(self.seen.base, part)

    def _each(self, paths: Sequence[str], kind: str, work: Callable[[str, StageProgress], R]) -> Iterator[R]:
        """What `work` makes of each frame that it can use, with a record; the others are skipped."""
        here: Workers[str, R] = Here(lambda path: self._console.progress(Path(path).name))
        for path, result in follow(here, work, paths, StageProgress()):
            if isinstance(result, Exception):
                self._skip([path], result)
            else:
                self._console.record(source=path, ok=True, kind=kind)
                yield result

    @contextmanager
    def _skipping(self, paths: Sequence[str]) -> Iterator[None]:
        """Skip these frames if they cannot be used together."""
        try:
            yield
        except (PanchromaError, MemoryError) as error:
            self._skip(paths, error)

    def _skip(self, paths: Sequence[str], error: Exception) -> None:
        """Say and record why these frames are skipped."""
        path, why = " ".join(paths), reason(error)
        line = why if path in why else f"{path}: {why}"
        self.seen.skipped.append(line)
        self._console.error(f"skipped {line}")
        self._console.record(source=path, ok=False, error=" ".join(why.split()))
