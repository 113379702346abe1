"""Frames that do not belong together, or are of another kind than they are given as, are refused
with that reason.

From measurements to a camera: what is measured replaces what was known, and what was not measured
stays.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from panchroma.shared import (
    Camera,
    CaptureMetadata,
    CfaPattern,
    Mosaic,
    NoiseModel,
    SensorCalibration,
)
from panchroma.shared.arrays import DoubleArray
from panchroma.shared.errors import InputError
from panchroma.tools.batch.console import Console
from panchroma.tools.calibration.conclude import Result, conclude
from panchroma.tools.calibration.files import KINDS, check_same
from panchroma.tools.calibration.gamma import GammaFit
from panchroma.tools.calibration.measure import Measurements, Session, measure_chart
from panchroma.tools.calibration.places import plateau
from tests.scenes import darker_corners
from tests.tools.calibration.known_camera import (
    BLIND,
    HEIGHT,
    NOISE,
    REFERENCE,
    TRUTH,
    WIDTH,
    chart,
    edited,
    frame,
    stating,
    true_place,
)

SHAPE = (HEIGHT, WIDTH)
EVEN = np.ones((*SHAPE, 3))
PATTERN = CfaPattern.bayer(6)
CMY = CfaPattern.of_letters("WYWC/YWCW/WCWM/CWMW", (0, 1), "CMY")
BROAD = (1 - np.eye(3)) / 2  # what cyan, magenta and yellow see of red, green and blue


@cache
def taken(kind: str, seed: int = 0) -> Mosaic:
    """A frame of a kind: "dark", "flat" in one of two lights, "chart"."""
    flat = (0.2 + 0.4 * (seed > 1)) * EVEN
    scenes: dict[str, Any] = {"dark": 0 * EVEN, "flat": flat, "chart": chart().rgb}
    return frame(scenes[kind], seed=10 + seed)


def several(
    kind: str, number: int, edit: Callable[[Mosaic], Mosaic] = lambda mosaic: mosaic
) -> dict[str, Mosaic]:
    return {f"{kind}{seed}.dng": edit(taken(kind, seed)) for seed in range(number)}


def measured(old: Camera | None = None, /, **frames: Mapping[str, Mosaic]) -> Measurements:
    """What frames show; old: of the file that is updated; frames: of each kind, by name."""
    every = {name: mosaic for named in frames.values() for name, mosaic in named.items()}
    session = Session(
        Console(quiet=True), Measurements(REFERENCE, old=old), None, every.__getitem__
    )
    return session.measure({kind: [*frames.get(kind, ())] for kind in KINDS}, true_place().corners)


def concluded(old: Camera | None = None, /, **frames: Mapping[str, Mosaic]) -> Result:
    return conclude(measured(old, **frames))


def louder(gain: float) -> NoiseModel:
    """The noise of the true sensor, so many times as large."""
    return NoiseModel(*(gain * np.array([NOISE.shot, NOISE.read])))


def window(mosaic: Mosaic) -> Mosaic:
    return Mosaic(mosaic.codes[60:360, 60:540], mosaic.pattern, mosaic.calibration)


def of_ten_bits(mosaic: Mosaic) -> Mosaic:
    says = replace(BLIND, black_level=(64.0,) * 4, white_level=1023)
    return Mosaic((mosaic.codes >> 2).astype(np.uint16), mosaic.pattern, says)


def of_model(model: str, **facts: Any) -> Callable[[Mosaic], Mosaic]:
    metadata = CaptureMetadata(make="Acme", model=model, **facts)
    return lambda mosaic: replace(mosaic, metadata=metadata)


Taken = Callable[[], Mosaic]
OTHERS: dict[str, Callable[[Mosaic], Mosaic]] = {
    "size is 480 x 300 pixels, that of chart0.dng is 600 x 400 pixels": window,
    "pattern is RGB period 6 .* that of chart0.dng is RGB period 6": lambda mosaic: replace(
        mosaic, pattern=CfaPattern.bayer(6, order="BGGR")
    ),
    "number of bits is 10, that of chart0.dng is 12": of_ten_bits,
    "sensor is other, that of chart0.dng is bench": lambda mosaic: stating(mosaic, sensor="other"),
    "model is Acme 2, that of chart0.dng is Acme 1": of_model("2"),
    "ISO is 200, that of chart0.dng is 100": of_model("1", iso=200),
}


@pytest.mark.parametrize("words", OTHERS)
def test_a_frame_that_is_not_like_the_others_is_refused(words: str) -> None:
    others = {"other.dng": OTHERS[words](taken("chart", 1))}
    seen = measured(shots={**several("chart", 1, of_model("1", iso=100)), **others})
    (line,) = seen.skipped
    assert re.match(f"other.dng: its {words}", line)
    assert np.array_equal(seen.gamma.gamma, clean_gamma().gamma)


def test_what_the_first_frame_does_not_state_is_compared_too() -> None:
    flats, charts = several("flat", 4, of_model("1")), several("chart", 1, of_model("2"))
    seen = measured(dark=several("dark", 2), flat=flats, shots=charts)
    assert seen.skipped[0].startswith("chart0.dng: its model is Acme 2, that of flat0.dng is Acme")
    darks = {
        f"dark{seed}.dng": of_model("1", exposure_time=exposure)(taken("dark", seed))
        for seed, exposure in enumerate((None, 2.0, 0.01))
    }
    shots = several("chart", 1, of_model("1", exposure_time=0.01))
    (line,) = measured(dark=darks, shots=shots).skipped
    assert line.startswith("dark2.dng: its exposure time is 0.01 s, that of dark1.dng is 2 s")


def test_frames_of_another_camera_file_are_told() -> None:
    def of_file(camera: str, black: float) -> Callable[[Mosaic], Mosaic]:
        return lambda mosaic: stating(mosaic, camera=camera, black_level=(black,) * 4)

    for black, number in ((256.0, 0), (200.0, 1)):
        shots = several("chart", 2, of_file("b", black))
        seen = measured(dark=several("dark", 2, of_file("a", 256.0)), shots=shots)
        assert len(seen.remarks) == number
        said = "chart0.dng states the calibration of another camera"
        assert all(said in line for line in seen.remarks)


def test_the_size_is_kept_and_an_update_with_another_one_is_refused(tmp_path: Path) -> None:
    camera = concluded(dark=several("dark", 2), shots=several("chart", 1)).camera
    assert camera.size == SHAPE
    check_same(tmp_path, camera, taken("chart"))
    said = "the frames have 480 x 300 pixels, those of the camera file 600 x 400"
    with pytest.raises(InputError, match=said):
        check_same(tmp_path, camera, window(taken("chart")))


def test_a_copy_of_a_chart_does_not_count_whatever_it_is_called() -> None:
    chart0 = taken("chart")
    says, metadata = stating(chart0, noise=NOISE).calibration, CaptureMetadata(iso=100)
    copy = Mosaic(chart0.codes.copy(), chart0.pattern, says, metadata)
    seen = measured(shots={**several("chart", 1), "copy.dng": copy})
    another = measured(shots=several("chart", 2))
    (line,) = seen.skipped
    assert line.startswith("copy.dng: it is the same shot as chart0.dng: a copy adds nothing")
    assert another.skipped == []
    assert (another.gamma.half_width < 0.8 * seen.gamma.half_width).all()


def concluded_kinds(kinds: tuple[str, ...], edit: Callable[[Mosaic], Mosaic]) -> Result:
    frames = {kind: several(kind, 4, edit) for kind in kinds}
    return concluded(**frames, shots=several("chart", 1, edit))


@cache
def clean_gamma(*kinds: str) -> GammaFit:
    return concluded_kinds(kinds, lambda mosaic: mosaic).measured.gamma


@pytest.mark.parametrize("kinds", [(), ("dark",), ("flat",), ("dark", "flat")])
@pytest.mark.parametrize("number", [1, 100])
def test_bad_pixels_cost_no_patch_and_no_colour(kinds: tuple[str, ...], number: int) -> None:
    """Stuck at any level: one in the white patch, or in every patch and elsewhere."""
    random = np.random.default_rng(number)
    middles = [(int(rows.mean()), int(columns.mean())) for rows, columns in true_place().measured()]
    places = np.array(middles if number > 1 else [middles[18]])
    places += random.integers(-3, 3, places.shape)
    more = random.integers(0, SHAPE, (number - len(places), 2))
    rows, columns = np.concatenate([places, more]).T
    stuck = random.choice([0, 1500, 4095, 4095], number)

    def bad(mosaic: Mosaic) -> Mosaic:
        codes = mosaic.codes.copy()
        codes[rows, columns] = stuck
        return replace(mosaic, samples=codes)

    outcome, clean = concluded_kinds(kinds, bad), clean_gamma(*kinds)
    gamma = outcome.measured.gamma
    assert (np.abs(gamma.gamma - clean.gamma) < 0.15 * clean.half_width).all()
    assert (gamma.half_width < 1.05 * clean.half_width).all()
    assert outcome.measured.shots[0].fit.used.all()
    assert outcome.facts["colour"]["mean_dE2000"] < 2
    assert outcome.verdict == ("use it" if len(kinds) == 2 else "use it with care")
    if len(kinds) == 2:
        true = set(zip(rows.tolist(), columns.tolist(), strict=True))
        assert len(true ^ set(outcome.camera.calibration.defects)) <= 1


def test_a_patch_that_does_not_fit_is_named_and_the_colour_stays() -> None:
    rows, columns = true_place().measured()[12]
    dirty, bright = chart().rgb.copy(), 1.3 * chart().rgb
    dirty[rows, columns] *= (3, 1, 0.4)
    for rgb, said in (
        (dirty, "the colour of blue does not fit the others, and was left out; avoid reflections"),
        (bright, "chart.dng: white left out: clipped, expose less"),
    ):
        outcome = concluded(shots={"chart.dng": frame(rgb)})
        assert sum(said in line for line in outcome.warnings) == 1, outcome.warnings
        assert outcome.facts["colour"]["mean_dE2000"] < 2
        assert outcome.findings["colour"].result[0].fit.used.sum() == 23
    over = concluded(shots={"chart.dng": frame(3 * chart().rgb)})
    assert "patches are clipped; expose less" in over.missing["colour"]


STATED = ((3, 4), (50, 60), (200, 300))


@pytest.mark.parametrize("old", [None, Camera(replace(BLIND, defects=STATED), PATTERN)])
def test_defects_of_one_kind_of_frames_are_added_and_those_of_both_replace_all(
    old: Camera | None,
) -> None:
    """Those that shots, or a camera file, state: hot pixels are at two of these places, and a hot
    and a dead one at places that nobody states.
    """
    hot, lit = np.zeros(SHAPE), np.ones(SHAPE)
    hot[3, 4] = hot[50, 60] = hot[7, 8] = 60
    lit[9, 10] = 0
    says = BLIND if old else stating(taken("chart"), defects=STATED).calibration
    shots = several("chart", 1, lambda mosaic: replace(mosaic, calibration=says))
    darks = several("dark", 2, lambda mosaic: edited(mosaic, lambda codes: codes + hot))
    flats = several("flat", 4, lambda mosaic: edited(mosaic, lambda codes: codes * lit))
    for frames, defects in (
        ({}, STATED),
        ({"dark": darks}, (*STATED[:1], (7, 8), *STATED[1:])),
        ({"flat": flats}, (*STATED[:1], (9, 10), *STATED[1:])),
        ({"dark": darks, "flat": flats}, ((3, 4), (7, 8), (9, 10), (50, 60))),
    ):
        outcome = concluded(old, shots=shots, **frames)
        assert outcome.camera.calibration.defects == defects
    said = "1 defects that the frames state show neither in dark nor in flat frames"
    assert (said in " ".join(outcome.warnings)) == (old is None)


def test_what_a_chart_states_of_lens_and_noise_is_not_lost_where_dark_frames_come_first() -> None:
    shading = darker_corners(SHAPE)
    even = {"even.dng": stating(taken("chart"), noise=NOISE, shading=shading)}
    base = measured(dark=several("dark", 2), shots=even).base
    assert (base.calibration.shading, base.calibration.noise) == (shading, NOISE)


@pytest.mark.parametrize(
    ("kind", "content", "words"),
    [
        ("dark", lambda: taken("chart"), "is not dark: its median is"),
        ("flat", lambda: taken("chart"), "is no flat frame: it shows a scene"),
        ("shots", lambda: taken("dark", 9), "there is no ColorChecker"),
        ("shots", lambda: frame(9 * chart().rgb), "there is no ColorChecker"),
    ],
)
def test_a_frame_of_another_kind_is_skipped_alone(kind: str, content: Taken, words: str) -> None:
    others = {"dark": several("dark", 2), "flat": several("flat", 4), "shots": several("chart", 1)}
    others[kind] = {"wrong.dng": content(), **others[kind]}
    seen = measured(**others)
    (line,) = seen.skipped
    assert re.search(f"^wrong.dng: .*{words}", line)
    assert seen.dark is not None
    assert seen.flats is not None
    assert len(seen.shots) == 1


@pytest.mark.parametrize("flats", [0, 4])
@pytest.mark.parametrize("off", [-24, 12])
def test_dark_frames_that_contradict_a_chart_are_to_blame(off: int, flats: int) -> None:
    """The message states by how much they are off; the dark patches, which tell it, are used."""
    darks = several("dark", 2, lambda mosaic: edited(mosaic, lambda every: every + off))
    outcome = concluded(dark=darks, flat=several("flat", flats), shots=several("chart", 1))
    assert outcome.camera is None
    assert "black level that the dark frames show" in outcome.refusal
    size, direction = re.search(r"seems to be (\S+) ± \S+ codes (\w+)", outcome.refusal).groups()
    assert direction == ("lower" if off > 0 else "higher")
    assert abs(float(size) / abs(off) - 1) < 0.2


@pytest.mark.parametrize("number", [1, 3])
def test_a_chart_contradicts_a_black_level_that_is_off_and_tells_it(number: int) -> None:
    off = replace(TRUTH, black_level=tuple(level + 16 for level in BLIND.black_level))
    shots = {f"{seed}.dng": frame(chart().rgb, seed=seed, truth=off) for seed in range(number)}
    outcome = concluded(shots=shots)
    gamma = outcome.measured.gamma
    assert (np.abs(gamma.gamma - TRUTH.gamma) < 1.5 * gamma.half_width).all()
    assert outcome.verdict == "do not use it"
    (said,) = outcome.contradictions
    assert "contradict the black level that is assumed" in said
    assert re.search(r"it seems to be 1.* codes higher; take dark frames \(`dark`\)", said)
    assert outcome.camera is not None  # gamma is honest, and dark frames may be added


def test_shots_of_two_cameras_are_contradicted() -> None:
    other = frame(chart().rgb, truth=replace(TRUTH, gamma=(0.8, 1.2, 0.9)))
    shots = {**several("chart", 1), "other.dng": other}
    outcome = concluded(dark=several("dark", 4), shots=shots)
    assert (outcome.verdict, outcome.camera) == ("do not use it", None)
    said = r"the shots contradict each other in gamma.*standard deviations: chart0.dng 0\.9"
    assert re.search(said, outcome.refusal)
    assert (outcome.measured.gamma.half_width > 0.05).all()  # of each alone it is about 0.01


@pytest.mark.parametrize("bend", [-0.1, -0.03, 0.03])
def test_a_sensor_that_is_not_linear_is_called_that(bend: float) -> None:
    """In place of a black level that would explain it less well."""

    def bent(mosaic: Mosaic) -> Mosaic:
        def response(codes: DoubleArray) -> DoubleArray:
            light = (codes - 256) / 3839
            return np.asarray(codes + 3839 * bend * light * abs(light))

        return edited(mosaic, response)

    shots, kinds = several("chart", 2, bent), ("dark", "flat")
    outcome = concluded(shots=shots, **{kind: several(kind, 4, bent) for kind in kinds})
    (line,) = [line for line in outcome.warnings if "not linear" in line]
    reads, size = re.search(r"reads (\d+) % too (\w+)", line).groups()
    assert size == ("little" if bend < 0 else "much")
    assert abs(float(reads) / 100 - abs(bend)) < 0.02 + 0.3 * abs(bend)
    assert not any("black level" in line for line in outcome.contradictions)


@pytest.mark.parametrize("stated", [96.0, 346.0])
def test_a_black_level_that_is_stated_wrongly_gives_way_to_dark_frames(stated: float) -> None:
    def loose(mosaic: Mosaic) -> Mosaic:
        return stating(mosaic, black_level=(stated,) * 4)

    shots = several("chart", 1, loose)
    seen = measured(dark=several("dark", 2, loose), flat=several("flat", 4, loose), shots=shots)
    assert (seen.skipped, seen.remarks) == ([], [])
    np.testing.assert_allclose(seen.gamma.gamma, (0.9, 1.1, 0.8), rtol=0.01)


def test_a_sensor_that_saturates_below_its_white_level_is_told_once() -> None:
    def ends(mosaic: Mosaic) -> Mosaic:
        codes = np.minimum(mosaic.codes, int(np.quantile(mosaic.codes, 0.99)))
        codes[codes[:, :5].argmin(axis=0), range(5)] = 4000  # others are hot in dark frames
        return replace(mosaic, samples=codes)

    def stuck(mosaic: Mosaic) -> Mosaic:
        return edited(mosaic, lambda codes: np.where(np.arange(WIDTH) == 300, 3900, codes))

    kinds = ("dark", 2), ("flat", 4), ("chart", 1)
    dark, flat, shots = (several(kind, number, stuck) for kind, number in kinds)
    assert measured(dark=dark, flat=flat, shots=shots).remarks == []
    seen = measured(dark=several("dark", 2, ends), shots=several("chart", 1, ends))
    (line,) = seen.remarks
    assert line.startswith("chart0.dng: 1.")
    assert "the sensor saturates there, and not at the white level, " in line


def test_a_black_border_is_no_saturation() -> None:
    codes = np.random.default_rng(0).integers(20000, 60000, (120, 180)).astype(np.uint16)
    codes[:12] = 0
    calibration = SensorCalibration.of_bits(16, headroom=False, black_level=(0,) * 4)
    assert plateau(Mosaic(codes, CfaPattern.bayer(6), calibration))[1] == 0


@pytest.mark.parametrize("gain", [0.5, 1.0, 1.6, 4.0])
@pytest.mark.parametrize("kinds", [("dark", "shots"), ("shots",), ("dark",)])
def test_flat_frames_of_another_gain_tell_no_noise(gain: float, kinds: tuple[str, ...]) -> None:
    other = replace(TRUTH, noise=louder(gain))
    flats = {
        f"flat{seed}.dng": frame(level * EVEN, seed=seed, truth=other)
        for seed, level in enumerate(np.repeat((0.04, 0.3, 0.6), 2))
    }
    frames = {"dark": several("dark", 3), "shots": several("chart", 2)}
    outcome = concluded(flat=flats, **{kind: frames[kind] for kind in kinds})
    told = [line for line in outcome.warnings if "noise was left out" in line]
    if gain == 1.0:
        assert (told, "noise" in outcome.facts) == ([], True)
    elif told:
        assert "noise" not in outcome.facts
        assert "flat0.dng" in told[0]
        assert "take all frames with one gain" in told[0]
        assert outcome.camera.calibration.noise is None
    else:  # dark frames alone tell only a gain that is clearly higher
        assert kinds == ("dark",)
        assert gain < 2


# --- what a camera file keeps ---------------------------------------------------------------------


def test_a_new_gamma_rescales_noise_that_was_measured_before() -> None:
    """Noise is in scene units; in codes it is the same."""
    known = replace(BLIND, noise=NOISE)
    stated = concluded(shots=several("chart", 1, lambda mosaic: stating(mosaic, noise=NOISE)))
    updated = concluded(Camera(known, PATTERN), shots=several("chart", 1))
    for new in (stated.camera.calibration, updated.camera.calibration):
        ratio = new.full_scale / known.full_scale
        assert abs(ratio - 1) > 0.05
        np.testing.assert_allclose(new.noise.shot, ratio * np.array(NOISE.shot))
        np.testing.assert_allclose(new.noise.read, ratio * np.array(NOISE.read))


def test_parts_that_were_measured_with_a_black_level_far_off_are_named() -> None:
    known = {"gamma": {}, "colour": {}, "black_level": {"standard_error": [0.01] * 4}}
    for off, count in ((0, 0), (6, 1)):
        black = tuple(level + off for level in TRUTH.black_level)
        old = Camera(replace(BLIND, black_level=black), PATTERN, known)
        warnings = " ".join(concluded(old, dark=several("dark", 2)).warnings)
        assert warnings.count("6.0 codes off the one with which gamma, colour") == count


def test_shading_with_which_gamma_was_not_measured_is_told() -> None:
    for colour, count in ((0.001, 0), (0.05, 1)):
        says = replace(BLIND, shading=darker_corners(SHAPE, colour=colour))
        old = Camera(says, PATTERN, {"gamma": {}, "shading": {}})
        warnings = " ".join(concluded(old, flat=several("flat", 4)).warnings)
        said = "otherwise than was known when gamma of the camera file were measured"
        assert warnings.count(said) == count


@pytest.mark.parametrize("gain", [1.0, 4.0])
def test_noise_of_a_camera_file_that_frames_contradict_is_told(gain: float) -> None:
    says = replace(TRUTH, noise=louder(gain))
    old = Camera(says, PATTERN, {"noise": {"from": "9 pairs", "read_error": [1e-6] * 4}})
    for frames, words in (
        ({"dark": several("dark", 3)}, "read .* dark frames"),
        ({"shots": several("chart", 1)}, "photon .* the chart"),
    ):
        said = f"noise in the camera file, from 9 pairs: their {words}"
        found = re.search(said, " ".join(concluded(old, **frames).warnings))
        assert bool(found) == (gain > 1)


def test_that_a_lens_has_no_shading_is_a_measurement() -> None:
    shading = darker_corners(SHAPE)
    known = Camera(replace(BLIND, shading=shading), PATTERN, {"shading": {"corner": [1, 0, 1]}})
    assert concluded(known, dark=several("dark", 2)).camera.calibration.shading == shading
    even = concluded(known, flat=several("flat", 4)).camera
    assert even.calibration.shading is None
    assert "corner" not in even.measured["shading"]


@pytest.mark.parametrize(
    ("spread", "verdict"), [(0.08, "use it with care"), (0.4, "do not use it")]
)
def test_colours_of_another_chart_are_not_used(spread: float, verdict: str) -> None:
    seen = measured(shots=several("chart", 1))
    other = np.random.default_rng(1).uniform(1 - spread, 1 + spread, (24, 3))
    seen.chart_colours = REFERENCE * other
    outcome = conclude(seen)
    assert outcome.verdict == verdict
    said = " ".join((*outcome.contradictions, *outcome.warnings))
    assert "colours differ from the reference by a mean dE2000" in said


@pytest.mark.parametrize(("brighter", "axis"), [(1.0, 0), (1.6, 0), (1.6, 1)])
def test_uneven_light_on_the_chart_is_told(brighter: float, axis: int) -> None:
    """Even where correcting the colours for it works."""
    slope = np.linspace(1, 1 / brighter, SHAPE[axis])
    shots = {"chart.dng": frame(chart().rgb * np.expand_dims(slope, (1 - axis, 2)))}
    outcome = concluded(dark=several("dark", 4), flat=several("flat", 4), shots=shots)
    assert outcome.verdict == ("use it with care" if brighter > 1 else "use it")
    told = any("the light on the chart is uneven" in line for line in outcome.warnings)
    assert told == (brighter > 1)


@pytest.mark.parametrize(
    ("right", "wrong", "names"),
    [
        (CfaPattern.bayer(6, "GRBG"), CfaPattern.bayer(6, "GBRG"), "red and blue"),
        (CMY, CfaPattern.of_letters("WMWC/MWCW/WCWY/CWYW", (0, 1), "CMY"), "magenta and yellow"),
    ],
)
def test_swapped_channels_show_on_a_chart(right: CfaPattern, wrong: CfaPattern, names: str) -> None:
    true, says = (replace(each, channels=right.channels) for each in (TRUTH, BLIND))
    light = chart().rgb if right.channels == "RGB" else chart().rgb @ BROAD
    taken = frame(light, pattern=right, says=says, truth=true)
    corners = true_place().corners
    shot = measure_chart("chart.dng", taken, Measurements(REFERENCE), corners)
    np.testing.assert_allclose(shot.fit.gamma, TRUTH.gamma, rtol=0.02)
    exchanged = replace(taken, pattern=wrong)
    said = f"the chart shows that {names} are exchanged.*{'/'.join(right.letters_from())}"
    with pytest.raises(InputError, match=said):
        measure_chart("chart.dng", exchanged, Measurements(REFERENCE), corners)
