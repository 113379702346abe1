"""Night, lamps, stars and noise: a burst is no worse than its reference alone, and none of its frames
is refused.
"""

from collections.abc import Iterable, Sequence

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from panchroma.offline import render
from panchroma.offline.burst import Motion, merge_burst
from panchroma.shared import CfaPattern, FloatArray, Mosaic, SensorCalibration
from panchroma.tools.simulation.sensor import simulate_sensor, typical_noise

from .scenes import picture, scene, taken

SHAPE, SHIFTS = (132, 150), ((0.0, 0.0), (1.3, -0.7), (-2.2, 1.6), (0.6, 2.4))
SCENES = [scene(Motion(shift), shape=SHAPE, strength=0) for shift in SHIFTS]
NOISY = SensorCalibration.of_bits(12, noise=typical_noise(SensorCalibration.of_bits(12)))


def shot(scenes: Iterable[FloatArray], stops: Sequence[int] = (0,) * 10) -> list[Mosaic]:
    """Frames of 12 bits of scenes, with usual noise."""
    random, pattern = np.random.default_rng(0), CfaPattern.bayer(6)
    pairs = zip(scenes, stops, strict=False)
    return [simulate_sensor(rgb, pattern, NOISY, 2.0**stop, random) for rgb, stop in pairs]


def darker(factor: int) -> list[FloatArray]:
    return [np.asarray(rgb / factor, np.float32) for rgb in SCENES]


def reasons(shots: list[Mosaic]) -> list[str]:
    """Why frames are not part of the picture of the first."""
    return [frame.reason for frame in merge_burst(shots, reference=0).frames]


def error(found: FloatArray, truth: FloatArray) -> float:
    """Of what is not the outermost border, decibels."""
    return float(10 * np.log10(np.square(found - truth)[2:-2, 2:-2].mean()))


def with_lamp(scenes: Iterable[FloatArray], way: int) -> list[FloatArray]:
    """Scenes in which a square lamp moves to the right from frame to frame."""
    lit = [rgb.copy() for rgb in scenes]
    for number, rgb in enumerate(lit):
        rgb[60:66, 30 + way * number :][:, :6] = 3
    return lit


def test_a_darker_frame_takes_no_colour_away() -> None:
    shots, truth = shot(darker(10), (0, -4)), darker(10)[0]
    merged = picture(merge_burst(shots, reference=0))
    assert error(merged, truth) < error(render(shots[0]).rgb, truth) + 0.2


def test_light_of_changing_colour_leaves_a_burst_better_than_one_frame() -> None:
    frames = [0.3 * rgb + 0.7 * rgb.mean(axis=2, keepdims=True) for rgb in SCENES]
    cast = np.array((0.9, 1, 1.15), np.float32)
    shots = shot([frames[0], *(rgb * cast for rgb in frames[1:])])
    merged, alone = picture(merge_burst(shots, reference=0)), render(shots[0]).rgb
    assert error(merged, frames[0]) < error(alone, frames[0]) - 1


def test_a_clipped_lamp_that_moves_stays_whole() -> None:
    shots = shot(with_lamp(SCENES, 20))
    alone, merged = render(shots[0]).rgb, picture(merge_burst(shots, reference=0))
    assert merged[60:66, 30:36].mean() > 0.8 * alone[60:66, 30:36].mean()


def test_a_frame_that_alone_measures_the_lamps_of_a_night_is_used() -> None:
    assert reasons(shot(with_lamp(darker(100), 0), (0, -4))) == ["", ""]


def test_a_small_lamp_that_moves_does_not_decide_what_agrees() -> None:
    assert reasons(shot(with_lamp(darker(5), 9))) == [""] * 4


@pytest.mark.parametrize("count", [6, 40])
def test_stars_on_a_black_sky_are_no_black_frame(count: int) -> None:
    y, x = np.random.default_rng(3).integers(12, 120, (2, count))
    sky = np.zeros((4, *SHAPE, 3), np.float32)
    for number, (down, across) in enumerate(((0, 0), (1, -1), (-2, 2), (1, 2))):
        sky[number, y + down, x + across] = np.linspace(0.2, 1, count)[:, None]
        sky[number] = gaussian_filter(sky[number], (1, 1, 0))
    assert reasons(shot(sky, (-4,) * 4)) == [""] * 4


def test_frames_of_other_scenes_are_no_reference_however_sharp_they_are() -> None:
    others = (scene(Motion((0.0, 400.0 * number)), shape=SHAPE) ** 2 for number in range(1, 5))
    frames = merge_burst(shot([*others, *SCENES, SCENES[0]])).frames
    assert [frame.used for frame in frames] == [False] * 4 + [True] * 5


def test_noise_makes_no_colour() -> None:
    shots = shot([np.repeat(rgb.mean(axis=2, keepdims=True), 3, axis=2) for rgb in SCENES])
    pictures = picture(merge_burst(shots, reference=0)), render(shots[0]).rgb
    merged, alone = (error(rgb, rgb.mean(axis=2, keepdims=True)) for rgb in pictures)
    assert merged < min(alone + 2, -57)


def rings() -> FloatArray:
    """Thin dark strokes on ochre."""
    y, x = np.indices(SHAPE)
    dark = np.exp(-np.square(np.hypot(y - 66, x - 75) % 9 - 4))[..., None]
    return (np.array((0.6, 0.5, 0.15)) * (1 - 0.7 * dark)).astype(np.float32)


@pytest.mark.parametrize("tile", ["K=6", "K=4", "RW/WB", "kodak"])
def test_frames_of_a_tripod_are_as_good_as_one_with_all_their_light(tile: str) -> None:
    pattern = CfaPattern.of_letters(tile)
    for still in (rings(), SCENES[0]):
        merged = picture(merge_burst(taken([still] * 8, 0.03, pattern), reference=0))
        (bright,) = taken([still], 0.03 / 8**0.5, pattern)
        assert error(merged, still) < error(render(bright).rgb, still) + 0.4


@pytest.mark.parametrize("pattern", [CfaPattern.bayer(6), CfaPattern.of_letters("RW/WB")])
def test_a_tripod_leaves_no_more_tint_in_strokes_than_one_frame(pattern: CfaPattern) -> None:
    """All frames have the same gaps in luminance under their sites."""
    still = rings()
    shots = taken([still] * 4, 0.01, pattern)
    merged, alone = picture(merge_burst(shots, reference=0)), render(shots[0]).rgb
    assert error(merged, still) < error(alone, still) - 1
