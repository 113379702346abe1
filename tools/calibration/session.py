"""Read and measure the frames of one camera, in the order in which one kind needs what another has shown."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from shared import Camera, Mosaic, SensorCalibration, read_dng
from shared.arrays import DoubleArray
from shared.colorimetry import Matrix
from shared.errors import InputError, PanchromaError
from tools.batch.console import Console
from tools.batch.html import without_folders
from tools.batch.jobs import reason
from tools.batch.progress import StageProgress
from tools.batch.work import Here, Workers, follow

from .content import check_dark, check_flat, why_no_chart
from .dark_frames import measure_dark
from .files import KINDS, Files
from .frame_sets import DARK_ALIKE, FLAT_ALIKE, refuse_copies
from .gamma import Assumed
from .noise import measure_flats, noise_of_flats
from .observations import Observations, ShotMeasurement, measure_chart
from .samples import figures, without
from .shading import measure_shading

_COMPARED = "dark", "flat"  # kinds of which copies are told from each other's noise, see `refuse_copies`
_FAR = 1 / 256  # of full scale, between two black levels: more than they drift
_FITS = 3.0  # ratio of the residuals of two fits, from which on one of them is wrong
_WHITE, _DIM = 18, 0.1  # the white patch; the part of full scale below which it shows much more noise than at three quarters
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
        self._frames: dict[bytes, tuple[str, str]] = {}  # digest of the samples -> path, kind
        self._base_path = self._doubt = ""
        self._stated: SensorCalibration | None = None  # by the frame that was read last
        self.seen = Observations()

    def measure(self, files: Files, chart_colours: DoubleArray, corners: Matrix | None) -> Observations:
        """Measure all frames; chart_colours, corners: see `shots`."""
        self.dark(files["dark"])
        self.flat(files["flat"])
        self.shots(files["shots"], chart_colours, corners)
        self.seen.lights = tuple(kind for kind in files if kind not in KINDS)
        for light in self.seen.lights:
            self.shots(files[light], chart_colours, light=light)
        if self._doubt and not self.seen.shots:
            self.seen.remarks.append(self._doubt)
        return self.seen

    def dark(self, paths: Sequence[str]) -> None:
        """Measure the dark frames; later frames get their black level."""
        if frames := self._unshaded(paths, "dark"):
            with self._skipping(paths):
                refuse_copies(frames, DARK_ALIKE)
                self.seen.dark = measure_dark([mosaic for _, mosaic in frames])
                self._known["black_level"] = tuple(self.seen.dark.black.tolist())
                self._console.say(self.seen.dark.words)
                if _far(self.seen.dark.black.tolist(), frames[0][1].calibration):
                    stated = figures(frames[0][1].calibration.black_level)
                    self._console.note(f"{frames[0][0]} states another black level than the dark frames show: {stated} codes")
        if self.seen.dark is None:  # what refused frames state is not the camera's
            self.seen.base = None

    def flat(self, paths: Sequence[str]) -> None:
        """Measure the flat frames; later frames get their shading."""
        if frames := self._unshaded(paths, "flat"):
            with self._skipping(paths):
                refuse_copies(frames, FLAT_ALIKE)
                if self.seen.dark and self._stated and _far(self.seen.dark.black.tolist(), self._stated):
                    stated, shown = figures(self._stated.black_level), figures(self.seen.dark.black)
                    self._doubt = (
                        f"flat frames state black level {stated}, dark frames show {shown} codes, on which noise and shading rest; "
                        "a chart shows which is right"
                    )
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
            mosaic, name = self._read(path, "shot"), Path(path).name
            if (shading := mosaic.calibration.shading) and (zoomed := shading.zoomed(mosaic.metadata.focal_length)):
                self._console.note(f"{path}: {zoomed}")
            return self._chart(name, mosaic, chart_colours, corners, progress)

        for shot in self._each(paths, "shot", measured):
            self._console.say(shot.words)
            self.seen.shots.append(replace(shot, light=light))

    def _chart(
        self, name: str, mosaic: Mosaic, chart_colours: DoubleArray, corners: Matrix | None, progress: StageProgress
    ) -> ShotMeasurement:
        """Measure a shot of a chart. Raises InputError that blames the dark frames, or the light, where these are to blame."""
        assumed = self._assumed(mosaic.calibration)
        measured: ShotMeasurement | None = None
        fault = ""
        try:
            measured = measure_chart(name, mosaic, chart_colours, corners, progress, assumed)
        except InputError as error:
            fault = str(error)
        by_stated: ShotMeasurement | None = None
        if stated := self._with_stated_black(mosaic):
            with suppress(InputError):
                place = measured.chart.place.corners if measured and measured.chart else corners
                by_stated = measure_chart(name, stated, chart_colours, place, progress, assumed)
        if stated and by_stated and (measured is None or _FITS * by_stated.fits[0].spread < measured.fits[0].spread):
            raise InputError(
                f"the chart fits the black level that the shot states ({figures(stated.calibration.black_level)} codes), but not "
                f"that of the dark frames ({figures(mosaic.calibration.black_level)}); take dark frames anew, with gain, exposure "
                "and temperature of the other shots"
            )
        if measured is None:
            raise InputError(why_no_chart(mosaic, found="ColorChecker" not in fault and "too small" not in fault) or fault)
        if measured.places is not None and measured.places.mean[_WHITE, -1] < _DIM:
            level = 100 * measured.places.mean[_WHITE, -1]
            self.seen.remarks.append(f"{name} is dark: its white patch reads {level:.1f} % of full scale; expose more, up to 75 %")
        return measured

    def _with_stated_black(self, mosaic: Mosaic) -> Mosaic | None:
        """Return a shot with the black level that it states; None if dark frames show the same, about, or have not measured it."""
        known = self._known.get("black_level")
        if known is None or self._stated is None or not _far(known, self._stated):
            return None
        return mosaic.calibrated(replace(mosaic.calibration, black_level=self._stated.black_level))

    def _assumed(self, calibration: SensorCalibration) -> Assumed:
        measured = self._old.measured if self._old else {}
        return Assumed.of(calibration, self.seen.dark, measured, even=self.seen.shading is not None)

    def _unshaded(self, paths: Sequence[str], kind: str) -> Frames:
        """Return the frames that can be read and are of this kind, without the shading that they state."""

        def checked(mosaic: Mosaic) -> None:
            if kind == "dark":
                check_dark(mosaic)
            else:
                check_flat(mosaic, black_measured="black_level" in self._known)

        return list(self._each(paths, kind, lambda path, _: (path, without(self._read(path, kind, checked), "shading"))))

    def _read(self, path: str, kind: str, check: Callable[[Mosaic], None] = lambda _: None) -> Mosaic:
        """Read a frame, and correct what it states.

        check: raises InputError if the frame shows that it is of another kind.

        Raises InputError for a copy of a frame before, and if it is from another camera, or was taken with other settings.
        """
        mosaic = self._read_file(path)
        # What one frame's colours suggest of the light is no part of a camera.
        self._stated = stated = replace(mosaic.calibration.without_estimates(), sensor=self._sensor or mosaic.calibration.sensor)
        mosaic = Mosaic(mosaic.codes, mosaic.pattern, stated, mosaic.metadata)
        self._check_same(mosaic, kind)
        mosaic = mosaic.calibrated(replace(stated, **self._known))
        check(mosaic)
        self._refuse_copy(path, kind, hashlib.sha256(mosaic.codes.data).digest())
        self._keep_statements(path, stated, mosaic)
        return mosaic

    def _refuse_copy(self, path: str, kind: str, key: bytes) -> None:
        """Raise InputError if a frame has the samples of one before: it adds nothing, and would count twice; key: of `_frames`."""
        if key not in self._frames:
            self._frames[key] = path, kind
            return
        first, before = self._frames[key]
        if before != kind or kind not in _COMPARED:
            which = f"it is given twice, as {before} and as {kind}" if first == path else f"it is the same shot as {first}"
            raise InputError(f"{which}: a copy adds nothing; leave it out")

    def _check_same(self, mosaic: Mosaic, kind: str) -> None:
        """Raise InputError unless a frame has size, pattern and levels of the first one: as they are stated."""
        if self.seen.base is None:
            return
        ours, first = _facts(mosaic), _facts(self.seen.base)
        if kind == "dark" or "black_level" in self._known:  # dark frames measure it, whatever a frame states
            del ours["black level"]
        for name, fact in ours.items():
            if fact != first[name] and (name != "sensor" or (fact and first[name])):
                raise InputError(
                    f"its {name} is {fact}, that of {self._base_path} is {first[name]}: all frames have to be from one camera, "
                    "with the same settings"
                )

    def _keep_statements(self, path: str, stated: SensorCalibration, mosaic: Mosaic) -> None:
        """Take over what a frame states of its camera, where the frames before do not; defects of all frames count."""
        self.seen.stated_defects |= set(stated.defects)
        if self.seen.base is None:
            self.seen.base, self._base_path = mosaic, path
            return
        base, own = self.seen.base.calibration, mosaic.calibration
        more: dict[str, Any] = {"shading": base.shading or own.shading, "aberration": base.aberration or own.aberration}
        if base.noise is None and own.noise is not None:
            more["noise"] = own.noise.in_units_of(own.full_scale / base.full_scale)
        if base.camera_to_xyz is None and base.neutral is None:
            more |= {name: getattr(own, name) for name in ("camera_to_xyz", "neutral", "lights")}
        self.seen.base = self.seen.base.calibrated(replace(base, **more))

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
        self.seen.skipped.append(without_folders(line, paths))
        self._console.error(f"skipped {line}", cause=error)
        self._console.record(source=path, ok=False, error=" ".join(why.split()))


def _far(black: Sequence[float], stated: SensorCalibration) -> bool:
    """Whether a black level is far from the stated one."""
    return max(abs(ours - theirs) for ours, theirs in zip(black, stated.black_level, strict=True)) > _FAR * stated.white_level


def _facts(mosaic: Mosaic) -> dict[str, str]:
    """Return what frames of one camera have in common, for people."""
    calibration, pattern = mosaic.calibration, mosaic.pattern
    return {
        "sensor": calibration.sensor,
        "size": f"{mosaic.shape[1]} x {mosaic.shape[0]} pixels",
        "pattern": f"{pattern.channels} period {pattern.period} ({' '.join(pattern.letters_from())})",
        "number of bits": str(calibration.bits),
        "white level": str(calibration.white_level),
        "black level": figures(calibration.black_level),
    }
