"""Black level, noise and defects from dark and flat frames: what they show, and which of them are
refused.
"""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from panchroma.shared import CfaPattern, InputError, Mosaic, NoiseModel
from panchroma.tools.calibration.conclude import Result, conclude
from panchroma.tools.calibration.dark_frames import DarkResult, measure_dark
from panchroma.tools.calibration.measure import Measurements
from panchroma.tools.calibration.photon_transfer import (
    FlatResult,
    fit_photon_transfer,
    measure_flats,
    noise_of_flats,
)
from tests.tools.calibration.known_camera import BLIND, NOISE, REFERENCE, TRUTH, edited, frame

SHAPE = (240, 360)
FULL = sum(TRUTH.gamma)
EXACT = np.zeros(4)  # standard error of a black level
FALLING = (1 - 0.3 * np.linspace(0, 1, SHAPE[1]))[None, :, None] * np.ones((SHAPE[0], 1, 3))

DEAD = np.zeros(SHAPE, bool)
DEAD[200, 300] = True


def darks(count: int, light: Any = 0.0) -> list[Mosaic]:
    return [frame(np.broadcast_to(light, (*SHAPE, 3)), seed=seed) for seed in range(count)]


def flats(*levels: float) -> list[Mosaic]:
    seeds = [(level, 100 * number + half) for number, level in enumerate(levels) for half in (0, 1)]
    return [frame(level * FALLING, seed=seed) for level, seed in seeds]


def with_row_noise(frames: list[Mosaic], sigma: float = 1.5, seed: int = 7) -> list[Mosaic]:
    """The frames with noise, of `sigma` codes, that all samples of a row have in common."""
    random = np.random.default_rng(seed)
    return [edited(each, lambda c: c + random.normal(0, sigma, (SHAPE[0], 1))) for each in frames]


def of_flats(frames: list[Mosaic], dark: DarkResult | None = None) -> FlatResult:
    """What flat frames show, which are called a, b ..."""
    return measure_flats(list(zip("abcdef", frames, strict=False)), dark)


def concluded(base: Mosaic, *seen: Any) -> Result:
    """What dark frames and flat frames, measured, mean for a camera."""
    return conclude(Measurements(REFERENCE, base, None, *seen))


def test_dark_frames_that_clearly_differ_are_refused_and_drift_is_no_noise() -> None:
    first, second, third = darks(3)
    drifted = edited(second, lambda codes: codes + 1)
    still = measure_dark([first, second, third])
    np.testing.assert_allclose(measure_dark([first, drifted, third]).read, still.read, rtol=1e-9)
    black = np.median(first.codes)
    for edit, words in (
        (lambda codes: black + 0 * codes, r"noise of frame 2 is 0\.2887 codes"),
        (lambda codes: black + 3 * (codes - black), "noise of frame 1 is .* of frame 2"),
        (lambda codes: codes + 100, "level of frame 1 is .* light fell in"),
    ):
        with pytest.raises(InputError, match=words):
            measure_dark([first, edited(second, edit)])
    with pytest.raises(
        InputError, match=r"^dark frames: .* of [RGW] read 0: the sensor cuts off noise"
    ):
        measure_dark([edited(each, lambda codes: codes - black) for each in (first, second)])


@pytest.mark.parametrize("count", [1, 2, 6])
def test_read_noise_of_rows_counts_once_a_row(count: int) -> None:
    """Samples of a row are no independent ones: the truth is 1.4 errors away at most."""
    truth, scores = np.hypot(np.array(NOISE.read) / FULL * (4095 - 256), 3.0), []
    for seed in range(10):
        found = measure_dark(with_row_noise(darks(count), 3.0, seed))
        scores.append((found.read - truth) / found.read_error)
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_flats_alone_say_how_little_they_know_of_read_noise() -> None:
    """Shot noise hides it: 5 % are out of reach, but the interval is honest and the warning names
    the remedy.
    """
    frames = flats(0.02, 0.3, 0.8)
    seen = of_flats(frames)
    noise = noise_of_flats(seen, BLIND, None, EXACT)
    read, error = np.array([(line.read, line.read_error) for line in noise.lines]).T
    true = np.array(NOISE.read) / FULL
    assert (np.abs(read - true) < 4 * error).all()
    assert error[-1] < 0.5 * true[-1]
    warnings = concluded(frames[0], None, seen).warnings
    assert sum("; take dark frames (`dark`), or" in line for line in warnings) == 1
    outcome = concluded(frames[0], measure_dark(darks(4)), seen)
    assert list(outcome.missing) == ["gamma", "colour", "shading"]
    assert len(outcome.warnings) == 3


def test_flats_without_partner_and_dead_pixels() -> None:
    pair = [edited(each, lambda codes: np.where(DEAD, 260, codes)) for each in flats(0.5)]
    single, clipped = frame(0.2 * FALLING), frame(3 * FALLING)
    seen = of_flats([*pair, single, clipped])
    assert seen.dead == ((200, 300),)
    assert seen.pairs == 1
    with pytest.raises(InputError, match="no two unclipped frames have the same exposure"):
        of_flats([single, clipped])


def test_one_exposure_is_enough_only_with_dark_frames() -> None:
    """Without them nothing tells shot noise from read noise, and the fit may give either as 0."""
    even = [frame(np.full((*SHAPE, 3), 0.5), seed=seed) for seed in range(2)]
    for pair in (even, flats(0.5)):
        seen = of_flats(pair)
        said = r"1 pair of flat frames tell the noise at full scale only to ±.*several exposures"
        with pytest.raises(InputError, match=said):
            noise_of_flats(seen, BLIND, None, EXACT)
        shot = noise_of_flats(seen, BLIND, measure_dark(darks(4)), EXACT).model(FULL).shot
        np.testing.assert_allclose(shot, NOISE.shot, rtol=0.1)


def test_codes_too_coarse_for_the_read_noise_leave_it_unknown() -> None:
    """Rounding hides a read noise of 0.2 codes: what is left after Sheppard's correction would
    be 0.
    """
    blunt = replace(BLIND, noise=NoiseModel((2e-4,) * 4, (0.2 * FULL / 3839,) * 4))
    black = np.zeros((*SHAPE, 3))
    frames = [frame(black, seed=seed, says=blunt, truth=blunt) for seed in range(2)]
    dark = measure_dark(frames)
    assert not dark.shows_read
    assert dark.defects == ()  # some pixels read a code more or less
    assert (dark.black_error > 0.2).all()
    seen = of_flats(flats(0.02, 0.3, 0.8))
    # From the flat frames.
    assert max(line.read_error for line in noise_of_flats(seen, BLIND, dark, EXACT).lines) > 0
    assert "use more gain or more bits" in " ".join(concluded(frames[0], dark).warnings)


def test_a_readout_channel_with_another_black_level_is_told() -> None:
    """One in four pixels, of green and panchromatic ones, is brighter by the read noise."""
    assert measure_dark(with_row_noise(darks(2))).sites == 0
    channel = np.tile([[0, 3], [0, 0]], (SHAPE[0] // 2, SHAPE[1] // 2))
    dark = measure_dark([edited(each, lambda codes: codes + channel) for each in darks(2)])
    assert dark.sites == pytest.approx(3 - 3 * 8 / 32, abs=0.1)
    assert "shadows will show a pattern" in " ".join(concluded(darks(1)[0], dark).warnings)


def test_a_hot_pixel_in_frames_without_noise_is_found() -> None:
    codes = np.full((60, 60), 64, np.uint16)
    codes[3, 4], codes[7, 8] = 1023, 164
    found = measure_dark([Mosaic(codes, CfaPattern.bayer(6), BLIND)] * 2)
    assert (found.step, found.defects) == (1, ((3, 4), (7, 8)))


def test_codes_that_were_shifted_to_more_bits_show_the_same_noise() -> None:
    levels = tuple(16 * black for black in BLIND.black_level)
    wide = replace(BLIND, black_level=levels, white_level=16 * 4095)

    def shifted(frames: list[Mosaic]) -> list[Mosaic]:
        return [Mosaic(16 * each.codes, each.pattern, wide) for each in frames]

    lit, found = flats(0.02, 0.3, 0.8), []
    for frames, says in ((lit, BLIND), (shifted(lit), wide)):
        lines = noise_of_flats(of_flats(frames), says, None, EXACT).lines
        found.append([(line.shot, line.read) for line in lines])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6)
    quiet = [edited(each, lambda codes: np.median(codes) + (codes > 258)) for each in darks(3)]
    assert not measure_dark(shifted(quiet)).shows_read
    dark, wider = measure_dark(darks(2)), measure_dark(shifted(darks(2)))
    np.testing.assert_allclose(wider.read, 16 * dark.read)
    assert wider.defects == dark.defects


def test_a_sensor_that_bends_below_its_white_level_is_told() -> None:
    """Light of 0.3 is half of full scale."""
    bent = [
        edited(each, lambda codes: codes - 0.4 * (codes - 2000).clip(0))
        for each in flats(0.05, 0.3, 0.8)
    ]
    dark = measure_dark(darks(4))
    warnings = " ".join(concluded(bent[0], dark, of_flats(bent, dark)).warnings)
    assert re.search("their read noise is .*no brighter than the sensor is linear", warnings)


def test_texture_does_not_pass_for_noise() -> None:
    mean, count = np.linspace(0.01, 0.9, 40), np.full(40, 400.0)
    variance = 1e-4 * mean + 1e-6
    variance[::9] *= 20
    line = fit_photon_transfer(mean, variance, count)
    assert (line.shot, line.read) == pytest.approx((1e-4, 1e-3), rel=1e-6)
    assert line.shot_error > 0


CORNER = np.zeros((*SHAPE, 1))
CORNER[:60, :90] = 0.02
LEAK = "light fell in: their levels are R .* W .* codes, with a noise of R .* cover lens"


@pytest.mark.parametrize(
    ("light", "count", "words"),
    [
        (0.005, 1, LEAK),
        ((0.02, 0.005, 0.0), 4, LEAK),
        (CORNER, 4, r"light fell in around row \d+, column \d+: W is .* codes further above"),
    ],
)
def test_light_that_leaks_in_is_told(light: Any, count: int, words: str) -> None:
    """Light of 1 is that of a chart's white."""
    with pytest.raises(InputError, match=words):
        measure_dark(darks(count, light))


def test_weak_light_is_told_where_black_is_even() -> None:
    uneven = np.array(TRUTH.black_level)[CfaPattern.bayer().filter_map(SHAPE)] - 256
    even = [edited(each, lambda codes: codes - uneven) for each in darks(4, 0.001)]
    with pytest.raises(InputError, match=LEAK):
        measure_dark(even)


def test_what_is_warm_or_offset_is_dark() -> None:
    """Heat lifts all filters alike, and electronics may lift one of them without noise."""
    glow = 40 * np.linspace(0, 1, SHAPE[1])
    random = np.random.default_rng(2)
    offset = np.where(CfaPattern.bayer().panchromatic_mask(SHAPE), 12, 0)

    def warm(codes: np.ndarray) -> np.ndarray:
        return codes + offset + random.poisson(np.broadcast_to(glow, SHAPE))

    measure_dark([edited(dark, warm) for dark in darks(4)])


def test_flats_that_are_too_dark_for_dead_pixels_list_none() -> None:
    """With some twenty electrons a pixel, thousands of good ones read less than half by chance."""
    seen = of_flats(flats(0.002, 0.01))
    assert (seen.dead, seen.blind > 0.3) == ((), True)
    seen = of_flats(flats(0.01))
    warnings = concluded(frame(np.zeros((12, 12, 3))), measure_dark(darks(4)), seen).warnings
    assert any("too dark, or too uneven, to tell dead pixels" in line for line in warnings)


def test_a_shadow_on_flats_is_no_list_of_dead_pixels() -> None:
    shadow = np.full((*SHAPE, 3), 0.5)
    shadow[:90, :120] = 0.05
    pair = [frame(shadow, seed=seed) for seed in range(2)]
    pair = [edited(each, lambda codes: np.where(DEAD, 262, codes)) for each in pair]
    assert of_flats(pair).dead == ((200, 300),)


def test_black_that_is_lower_than_taken_for_does_not_tilt_the_line() -> None:
    """Flat frames alone, black 40 codes off: the variance at the assumed black is negative by the
    line.
    """
    wrong = replace(BLIND, black_level=tuple(black - 100 for black in BLIND.black_level))
    frames = [Mosaic(each.codes, each.pattern, wrong) for each in flats(0.1, 0.3, 0.8)]
    seen = of_flats(frames)
    camera = concluded(frames[0], None, seen).camera
    for name, most in (("shot", 1.5), ("read", 1)):
        found = np.array(getattr(camera.calibration.noise, name))
        errors = np.array(camera.measured["noise"][f"{name}_error"])
        assert (np.abs(found * FULL / 3 - getattr(NOISE, name)) < most * 1.96 * errors).all()


def flickering(amplitude: float, period: int, *levels: float) -> list[Mosaic]:
    """Pairs of flat frames of a rolling shutter under a lamp that flickers."""
    rows = 2 * np.pi * np.arange(SHAPE[0])[:, None, None] / period
    return [
        frame(level * FALLING * (1 + amplitude * np.sin(rows + 2.1 * number)), seed=number)
        for number, level in enumerate(np.repeat(levels, 2))
    ]


@pytest.mark.parametrize("period", [12, 90])
@pytest.mark.parametrize("amplitude", [0.003, 0.01, 0.03, 0.1])
def test_light_that_flickers_is_told_and_passes_for_no_noise(amplitude: float, period: int) -> None:
    """With it photon noise would be up to 13 times as large."""
    dark = measure_dark(with_row_noise(darks(6)))
    frames = with_row_noise(flickering(amplitude, period, 0.1, 0.4, 0.8))
    seen = of_flats(frames, dark)
    assert len(seen.flicker) >= 2
    said = "([ab] and [ab]|[cd] and [cd]|[ef] and [ef]): the light flickers, rows differ by"
    assert all(re.match(said, line) for line in seen.flicker)
    noise = noise_of_flats(seen, BLIND, dark, EXACT)
    for line, shot in zip(noise.lines, NOISE.shot, strict=True):
        assert abs(line.shot * FULL - shot) < 3.5 * line.shot_error * FULL
    with pytest.raises(InputError, match=r"light flickers.*or add dark frames \(`dark`\)"):
        of_flats(frames)
    for known in (dark, None):
        assert of_flats(with_row_noise(flats(0.1, 0.4, 0.8)), known).flicker == []
