"""Measure the frames of one camera, in the order in which one kind needs what another has shown.
Start reading here.

`Session` reads and measures, `conclude.conclude` makes a camera of what was measured,
`report.build_report` shows it.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...shared import Camera, DoubleArray, InputError, Mosaic, SensorCalibration, read_dng
from ...shared.arrays import ByteArray
from ...shared.colorimetry import Matrix
from ..batch.console import Console
from ..batch.jobs import reason
from ..io.page import without_folders
from .chart.find import chart_at, find_chart, overlay
from .chart.place import ChartPlace
from .colour_matrix import FEWEST_CHANNELS, check_channel_order, expected_levels
from .dark_frames import DarkResult, check_dark, measure_dark
from .files import KINDS, Files
from .gamma import Assumed, GammaFit, combined, fit_gamma, fit_with_derived, with_surroundings
from .measured_shading import ShadingResult, measure_shading
from .photon_transfer import FlatResult, check_flat, measure_flats, noise_of_flats
from .places import Named, PlaceSamples, figures, patch_samples, plateau, without_shading

# Of full scale, between two black levels: more than they drift with temperature (see
# gamma._STEADY).
_FAR = 1 / 256
# Half width over gamma that a large chart reaches by itself: no areas around it are measured.
_REACHED = 0.02

_CHECKS = {"dark": check_dark, "flat": check_flat}
R = TypeVar("R")
Reader = Callable[[str], Mosaic]
"""Reads a frame."""


@dataclass(frozen=True, eq=False)
class ShotMeasurement:
    """Measurements of one shot of the chart.

    Attributes
    ----------
    name : str
        File name.
    fit : GammaFit
        gamma; its calibration is that stored in the shot, with the black level that the
        measurements refer to.
    chart : ChartPlace
        Place of the chart.
    places : PlaceSamples
        Statistics of the patches.
    picture : ByteArray
        uint8 RGB (H, W, 3), the shot with the patches outlined.
    light : str
        The one of two on the chart, "" = the only one.
    """

    name: str
    fit: GammaFit
    chart: ChartPlace
    places: PlaceSamples
    picture: ByteArray
    light: str = ""


@dataclass(eq=False)
class Measurements:
    """Measurements of the frames of one camera; None = not measured.

    Attributes
    ----------
    chart_colours : DoubleArray
        (24, 3), XYZ (D50) of the chart, white = 1.
    base : Mosaic | None
        The first frame that was read: its pattern, levels and sensor are those of the camera. None
        = no frame could be read.
    old : Camera | None
        The camera file that is updated; None = there is none.
    dark : DarkResult | None
        Of dark frames.
    flats : FlatResult | None
        Of pairs of flat frames.
    shots : list[ShotMeasurement]
        Of each shot of a chart.
    lights : tuple[str, ...]
        The names of the two lights on the charts; () = one light, whose name does not matter.
    shading : ShadingResult | None
        Of flat frames.
    stated_defects : set[tuple[int, int]]
        (row, column) of the defects that the frames state.
    skipped : list[str]
        A line for each frame, or set of frames, that could not be used.
    remarks : list[str]
        Why flat frames do not show shading or noise, why an earlier measurement is kept, and below
        which white level the sensor saturates.
    """

    chart_colours: DoubleArray
    base: Mosaic | None = None
    old: Camera | None = None
    dark: DarkResult | None = None
    flats: FlatResult | None = None
    shots: list[ShotMeasurement] = field(default_factory=list)
    lights: tuple[str, ...] = ()
    shading: ShadingResult | None = None
    stated_defects: set[tuple[int, int]] = field(default_factory=set)
    skipped: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def known(self) -> dict[str, dict[str, Any]]:
        """The parts that the old camera file describes: name -> how it was measured."""
        return {name: dict(facts) for name, facts in self.old.measured.items()} if self.old else {}

    @property
    def calibration(self) -> SensorCalibration:
        """Calibration of the old camera file, or of the frames, with the black level of the dark
        frames.

        Raises InputError if no frame was read.
        """
        if self.base is None:
            raise InputError("no frame could be used")
        calibration = self.base.calibration
        if self.old:
            known = self.old.calibration
            calibration = replace(known, sensor=known.sensor or calibration.sensor)
        if self.dark:
            calibration = replace(calibration, black_level=tuple(self.dark.black.tolist()))
        return calibration

    @property
    def planes(self) -> str:
        """The letters of all planes: the channels, then panchromatic."""
        return self.calibration.channels + "W"

    @property
    def gamma(self) -> GammaFit | None:
        """Gamma as all shots show it together; None = there are none."""
        return combined([shot.fit for shot in self.shots]) if self.shots else None

    @property
    def gammas(self) -> dict[str, GammaFit]:
        """Gamma under each light where it depends on that, by its name; otherwise that of all
        shots, by "".
        """
        follows = all(shot.fit.follows for shot in self.shots)
        fits: dict[str, list[GammaFit]] = {}
        for shot in self.shots:
            fits.setdefault("" if follows else shot.light, []).append(shot.fit)
        return {light: combined(of_light) for light, of_light in fits.items()}

    def assumed(self, calibration: SensorCalibration | None = None) -> Assumed:
        """Return how far black level and shading may be off.

        calibration: of a frame, None = that of the camera.
        """
        shading = {} if self.shading is None else {"shading": self.shading}
        return Assumed(calibration or self.calibration, self.dark, self.known | shading)


def measure_chart(
    name: str, mosaic: Mosaic, measured: Measurements, corners: Matrix | None = None
) -> ShotMeasurement:
    """Find the chart in a shot, measure its patches, and estimate gamma from them.

    Raises InputError with the reason, if the shot cannot be used.

    Parameters
    ----------
    name
        Of the file.
    mosaic
        The shot.
    measured
        The colours of the chart, and what was measured before.
    corners
        Of the chart, see `ChartPlace`; None = find it.
    """
    if len(mosaic.pattern.channels) < FEWEST_CHANNELS:
        sensor = f"a sensor with the channels {mosaic.pattern.channels}"
        remedy = "calibrate it with dark and flat frames alone"
        raise InputError(f"{sensor} cannot tell the colours of a chart apart: {remedy}")
    reference, assumed = measured.chart_colours, measured.assumed(mosaic.calibration)
    chart = chart_at(mosaic, corners, reference) if corners else find_chart(mosaic, reference)
    places, derived = patch_samples(mosaic, chart.measured()), mosaic.pattern.derived
    if derived is None:
        fit = fit_gamma(places, assumed)
        if fit.worst > _REACHED and (areas := chart.around(mosaic.shape, mosaic.pattern.period)):
            fit = with_surroundings(fit, places, patch_samples(mosaic, areas))
    else:
        levels, letter = np.delete(places.mean, derived, axis=1), mosaic.pattern.channels[derived]
        expected = expected_levels(levels, reference, chart.centres, letter)
        fit, places = fit_with_derived(places, assumed, derived, expected)
    check_channel_order(places.mean[:, :-1], reference, mosaic.pattern)
    return ShotMeasurement(name, fit, chart, places, overlay(mosaic, chart))


class Session:
    """Measures the frames of one camera. A frame that cannot be used is skipped, with a line that
    says why.

    Parameters
    ----------
    console
        For lines, records and progress.
    measured
        Takes what is measured. Black level, shading and gamma of a camera file that is updated
        count as known.
    sensor
        Name of the sensor; None = the name in the frames.
    read
        See `Reader`.
    """

    def __init__(
        self, console: Console, measured: Measurements, sensor: str | None, read: Reader = read_dng
    ) -> None:
        self.console, self.measured = console, measured
        self._sensor, self._read_file, old = sensor, read, measured.old
        # Fields of the calibration that count more than what a frame states.
        self._known: dict[str, Any] = {}
        self._defects = set(old.calibration.defects if old else ())
        if old:
            self._known["shading"] = old.calibration.shading
            if "black_level" in old.measured:
                self._known["black_level"] = old.calibration.black_level
        self._paths: dict[bytes, str] = {}  # by digest of the samples
        self._ends = set[int]()  # codes at which samples end below the white level
        self._has_shot = False
        self._facts = dict[str, tuple[str, str]]()  # path of the first frame that states each
        # By the id of the camera file that a frame states: the first such frame, and its black.
        self._cameras: dict[str, tuple[str, tuple[float, ...]]] = {}

    def measure(self, files: Files, corners: Matrix | None = None) -> Measurements:
        """Measure all frames, kind by kind.

        files: paths of each kind. corners: of the chart in the only shot, see `ChartPlace`; None =
        find it.
        """
        self.dark(files["dark"])
        self.flat(files["flat"])
        self.shots(files["shots"], corners)
        self.measured.lights = tuple(kind for kind in files if kind not in KINDS)
        for light in self.measured.lights:
            self.shots(files[light], light=light)
        return self.measured

    def dark(self, paths: Sequence[str]) -> None:
        """Measure the dark frames; later frames get their black level."""
        if not (frames := self._unshaded(paths, "dark")):
            return
        names, mosaics = zip(*frames, strict=True)
        try:
            dark = self.measured.dark = measure_dark(mosaics, names)
        except InputError as error:
            self._skip(paths, error)
            # What refused frames state is not the camera's.
            self.measured.base = None
            self._facts.clear()
            return
        self.console.say(dark.words)
        path, first = frames[0]
        stated = first.calibration
        far = np.abs(dark.black - stated.black_level).max() > _FAR * stated.white_level
        if far and "black_level" not in self._known:  # else frames have that of the camera file
            fault = "states another black level than the dark frames show"
            self.console.note(f"{path} {fault}: {figures(stated.black_level)} codes")
        self._known["black_level"] = tuple(dark.black.tolist())
        self._defects |= set(dark.defects)

    def flat(self, paths: Sequence[str]) -> None:
        """Measure the flat frames: their shading, which later frames get, and noise, which only
        pairs of them show. What a shot states of its shading does not count any more.
        """
        if not (frames := self._unshaded(paths, "flat")):
            return
        measured = self.measured
        if measured.base is not None:
            measured.base = without_shading(measured.base)
        before = self._known.setdefault("shading", None)
        try:
            measured.shading = measure_shading(frames)
        except InputError as error:
            kept = ", and the one before is kept" if before else ""
            measured.remarks.append(f"no shading was measured{kept}: {error}")
        else:
            self._known["shading"] = measured.shading.shading
            self.console.say(measured.shading.words)
        calibration = frames[0][1].calibration
        try:
            flats = measure_flats(frames, measured.dark)
            # Frames that do not show it are refused here, where they can be named.
            noise_of_flats(flats, calibration, measured.dark, measured.assumed(calibration).black)
            measured.flats = flats
        except InputError as error:
            if measured.shading is None:
                self._skip(paths, error)
            else:
                measured.remarks.append(f"no noise was measured: {error}")

    def shots(self, paths: Sequence[str], corners: Matrix | None = None, light: str = "") -> None:
        """Measure shots of a chart.

        light: see `ShotMeasurement`. corners: see `measure`, of each shot.
        """

        def measure(path: str, mosaic: Mosaic) -> ShotMeasurement:
            shading, focal_length = mosaic.calibration.shading, mosaic.metadata.focal_length
            if shading and (zoomed := shading.zoomed(focal_length)):
                self.console.note(f"{path}: {zoomed}")
            return measure_chart(Path(path).name, mosaic, self.measured, corners)

        for shot in self._process(paths, "shot", measure):
            gamma = f"gamma {figures(shot.fit.gamma)} ± {figures(shot.fit.half_width)}"
            self.console.say(f"{shot.name}: chart at {shot.chart}, {gamma}")
            self.measured.shots.append(replace(shot, light=light))

    def _unshaded(self, paths: Sequence[str], kind: str) -> list[Named]:
        """Return the frames that can be read, without the shading that they state."""
        frames = self._process(paths, kind, lambda path, mosaic: (path, without_shading(mosaic)))
        return list(frames)

    def _read(self, path: str, kind: str) -> Mosaic:
        """Return a frame with what is known of the camera.

        Raises InputError for a copy of a frame before, if it is from another camera or was taken
        with other settings, and for a dark or flat frame that is none.
        """
        mosaic = self._read_file(path)
        # What one frame's colours suggest of the light is no part of a camera.
        stated, base = mosaic.calibration.without_estimates(), self.measured.base
        sensor = self._sensor or stated.sensor or (base.calibration.sensor if base else "")
        facts = self._checked_facts(path, mosaic, kind)
        if stated.camera and stated.camera not in self._cameras:
            for first, black in [*self._cameras.values()][:1]:
                line = f"{path} states the calibration of another camera file than {first}"
                if np.abs(np.subtract(stated.black_level, black)).max() > _FAR * stated.white_level:
                    levels = f"{figures(stated.black_level)} codes, and not {figures(black)}"
                    self.measured.remarks.append(f"{line}, with a black level of {levels}")
                self.console.note(f"{line}: are all frames from one camera?")
            self._cameras[stated.camera] = path, stated.black_level
        defects = tuple(sorted(self._defects.union(stated.defects)))
        calibration = replace(stated, sensor=sensor, **self._known, defects=defects)
        mosaic = replace(mosaic, samples=mosaic.codes, calibration=calibration)
        if check := _CHECKS.get(kind):
            check(mosaic)
        first = self._paths.setdefault(hashlib.sha256(mosaic.codes.data).digest(), path)
        if first != path:
            raise InputError(f"it is the same shot as {first}: a copy adds nothing; leave it out")
        end, share = (0, 0.0) if kind == "dark" else plateau(mosaic)
        if share and end not in self._ends:
            self._ends.add(end)
            self.measured.remarks.append(
                f"{path}: {100 * share:.1f} % of its samples have its highest code, {end}, and "
                f"hardly any a lower one nearby: the sensor saturates there, and not at "
                f"the white level, {mosaic.calibration.white_level}; state it in the camera.json "
                "with which they are captured, and take the shots again"
            )
        self.measured.stated_defects |= set(stated.defects)
        self._facts = facts | self._facts
        if self.measured.base is None or (kind == "shot" and not self._has_shot):
            # A shot of the chart states colours and noise, where others may not.
            self.measured.base = mosaic
        self._has_shot |= kind == "shot"
        return mosaic

    def _checked_facts(self, path: str, mosaic: Mosaic, kind: str) -> dict[str, tuple[str, str]]:
        """Return what a frame states of size, pattern, levels and settings, each with its path.

        Raises InputError unless that is what the frames before have stated.
        """
        facts = _facts(mosaic)
        # Dark frames measure black, whatever a frame states; it may change with the exposure time.
        if kind == "dark" or "black_level" in self._known:
            del facts["black level"]
        if kind != "dark":
            del facts["exposure time"]
        for name, fact in facts.items():
            first, before = self._facts.get(name, ("", ""))
            if fact != before and fact and before:  # some may not be stated
                both = f"its {name} is {fact}, that of {first} is {before}"
                remedy = "all frames have to be from one camera, with the same settings"
                raise InputError(f"{both}: {remedy}")
        return {name: (path, fact) for name, fact in facts.items() if fact}

    def _process(
        self, paths: Sequence[str], kind: str, work: Callable[[str, Mosaic], R]
    ) -> Iterator[R]:
        """Yield the result of `work` for each frame that it can use, with a record; the others are
        skipped.
        """
        for path in paths:
            try:
                with self.console.progress(Path(path).name) as progress:
                    progress.stage("measuring", 1)
                    result = work(path, self._read(path, kind))
            except Exception as error:
                self._skip([path], error)
            else:
                self.console.record(source=path, ok=True, kind=kind)
                yield result

    def _skip(self, paths: Sequence[str], error: Exception) -> None:
        """Say and record why these frames are skipped."""
        path, why = " ".join(paths), reason(error)
        line = why if why.startswith(path) else f"{path}: {why}"
        self.measured.skipped.append(without_folders(line, paths))
        self.console.error(f"skipped {line}", cause=error)
        self.console.record(source=path, ok=False, error=" ".join(why.split()))


def _facts(mosaic: Mosaic) -> dict[str, str]:
    """Return what frames of one calibration have in common, for people; "" = not stated."""
    calibration, pattern, taken = mosaic.calibration, mosaic.pattern, mosaic.metadata
    exposure, letters = taken.exposure_time, " ".join(pattern.letters_from())
    return {
        "sensor": calibration.sensor,
        "model": " ".join(filter(None, (taken.make, taken.model))),
        "ISO": "" if taken.iso is None else str(taken.iso),
        "exposure time": "" if exposure is None else f"{exposure:.3g} s",
        "size": f"{mosaic.shape[1]} x {mosaic.shape[0]} pixels",
        "pattern": f"{pattern.channels} period {pattern.period} ({letters})",
        "number of bits": str(calibration.bits),
        "white level": str(calibration.white_level),
        "black level": figures(calibration.black_level),
    }
