"""Bursts in which something moves, and frames that do not fit: what changed is taken from the
reference alone.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, minimum_filter

from panchroma.offline import BEST, render
from panchroma.offline.burst import Motion, merge_burst, select
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import BoolArray, DoubleArray, FloatArray
from panchroma.tools.simulation.sensor import simulate_additive

from .scenes import picture, scene, taken

_SHAPE = (132, 150)
_SHIFTS = ((0.0, 0.0), (1.3, -0.7), (-2.2, 1.6), (0.6, 2.4))
_PATTERN = CfaPattern.bayer(6)
_THING = (45, 75)  # rows that it covers
# decibels; a thing that only its colour shows is found to within a block
_AS_GOOD = {"other": 0.3, "equal": 0.8}
_SETTINGS = replace(BEST, learned=replace(BEST.learned, used=False))


def scene_after(shift: tuple[float, float]) -> FloatArray:
    return scene(Motion(shift), shape=_SHAPE, strength=0)


def covered(number: int) -> BoolArray:
    """Where the thing is in a frame; the camera's shift of it is less than its own way."""
    left = 20 + 14 * number
    mask = np.zeros(_SHAPE, bool)
    mask[slice(*_THING), left : left + 36] = True
    return mask


def with_thing(kind: str) -> list[FloatArray]:
    """The frames; "equal": the thing has the luminance of what it hides."""
    frames = [scene_after(shift) for shift in _SHIFTS]
    for number, frame in enumerate(frames):
        hidden = frame[covered(number)]
        if kind == "equal":
            tint = np.array([0.6, 0.2, 0.2], np.float32)
            frame[covered(number)] = hidden.sum(axis=1, keepdims=True) * tint
        elif kind == "other":
            frame[covered(number)] = np.array([0.2, 0.3, 0.7], np.float32)
    return frames


def error(result: FloatArray, truth: FloatArray, where: BoolArray) -> float:
    """Mean squared error, decibels."""
    return float(10 * np.log10(np.square(result[where] - truth[where]).mean() + 1e-7))


@pytest.mark.parametrize(
    ("kind", "sigma"), [("other", 0.0), ("other", 0.03), ("equal", 0.0), ("equal", 0.01)]
)
def test_what_moves_is_as_in_a_single_render(
    kind: str, sigma: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = with_thing(kind)
    shots = taken(frames, sigma)
    changed = np.any([covered(number) for number in range(len(frames))], axis=0)
    alone = error(render(shots[0], _SETTINGS).rgb, frames[0], changed)

    def merged_error() -> float:
        merged = merge_burst(shots, _SETTINGS, reference=0)
        return error(picture(merged, _SETTINGS), frames[0], changed)

    assert merged_error() < alone + _AS_GOOD[kind]
    monkeypatch.setattr(select, "agreement", lambda *_: np.full(_SHAPE, 255, np.uint8))
    assert merged_error() > alone + 3, "the measure sees no ghost where all is trusted"


def _flash(frame: FloatArray) -> FloatArray:
    y, x = np.mgrid[: _SHAPE[0], : _SHAPE[1]]
    flash = 0.8 + np.exp(-((y - 60) ** 2 + (x - 70) ** 2) / 2500)
    return np.asarray(frame * flash[..., None], np.float32)


def _turned(frame: FloatArray) -> FloatArray:
    return np.pad(np.rot90(frame[:, :132], 2), ((0, 0), (0, 18), (0, 0)), "edge")


ODD: dict[str, Callable[[FloatArray], FloatArray]] = {
    "out of focus": lambda frame: gaussian_filter(frame, (2, 2, 0)),
    "is lit differently": _flash,
    "black": np.zeros_like,
    "pixels, the reference": lambda frame: frame[:120],
    "cannot be aligned": _turned,
}


@pytest.mark.parametrize("reason", list(ODD))
@pytest.mark.parametrize("sigma", [0.0, 0.03])
def test_an_odd_frame_is_refused_by_name_and_is_no_reference(reason: str, sigma: float) -> None:
    frames = [scene_after(shift) for shift in _SHIFTS]
    frames[1] = ODD[reason](frames[1])
    merged = merge_burst(taken(frames, sigma), _SETTINGS)
    assert [frame.used for frame in merged.frames] == [True, False, True, True]
    assert reason in merged.frames[1].reason
    assert merged.reference != 1


def test_other_sensors_are_refused_and_other_codes_are_not() -> None:
    shots = taken([scene_after(shift) for shift in _SHIFTS])
    pattern = CfaPattern.of_letters("CMWWWW/YGWWWW" + 4 * "/WWWWWW")  # other channels, too
    cmyg = SensorCalibration(pattern.channels)
    shots[1] = Mosaic(shots[1].samples, pattern, cmyg)
    shots[2] = replace(shots[2], calibration=SensorCalibration(gamma=(0.8, 1, 1)))
    shots[3] = replace(shots[3], calibration=SensorCalibration.of_bits(12))
    first, *reasons, last = (frame.reason for frame in merge_burst(shots, reference=0).frames)
    assert first == last == ""
    assert reasons[0] == "has another filter pattern than the reference"
    assert "another camera" in reasons[1]


def bracketed(
    exposures: tuple[float, ...],
    bright: Callable[[FloatArray, DoubleArray], DoubleArray],
    width: float,
) -> tuple[list[Mosaic], list[FloatArray]]:
    """Frames of 12 bits with a bright spot, and the scenes. bright: puts a Gaussian spot into
    a scene.
    """
    y, x = np.mgrid[: _SHAPE[0], : _SHAPE[1]]
    noise = NoiseModel((2e-4,) * 4, (2e-3,) * 4)
    calibration, shots, truth = SensorCalibration.of_bits(12, noise=noise), [], []
    for number, exposure in enumerate(exposures):
        down, across = _SHIFTS[number]
        spot = np.exp(-((y - down - 60.5) ** 2 + (x - across - 69.5) ** 2) / width)
        truth.append(bright(scene_after(_SHIFTS[number]), spot[..., None]).astype(np.float32))
        exposed, rng = truth[-1] * np.float32(exposure), np.random.default_rng(number)
        seen = simulate_additive(exposed, _PATTERN, calibration, 0.002, rng)
        shots.append(Mosaic(seen.codes, _PATTERN, calibration))
    return shots, truth


def test_a_bracket_shows_what_one_exposure_clips() -> None:
    """And its steps are measured, so nobody has to state them."""
    exposures = 1, 0.25, 2
    shots, (truth, *_) = bracketed(exposures, lambda scene, spot: scene * (0.6 + 2.0 * spot), 150)
    merged = merge_burst(shots, _SETTINGS, reference=0)
    assert [frame.reason for frame in merged.frames] == [""] * 3
    assert [frame.gain for frame in merged.frames] == pytest.approx(exposures, rel=0.01)
    clipped = truth.sum(axis=2) > 3
    assert clipped.any()
    single, both = render(shots[0], _SETTINGS).rgb, picture(merged, _SETTINGS)
    assert error(both, truth, clipped) < error(single, truth, clipped) - 3
    assert error(both, truth, ~clipped) < error(single, truth, ~clipped)
    assert merge_burst(shots[::-1], _SETTINGS).reference != 0, "the longest exposure is clipped"


@pytest.mark.parametrize("tint", [(1.0, 0.8, 0.6), (0.7, 0.9, 1.0)])
@pytest.mark.parametrize("reference", [0, 1])
def test_rings_of_coloured_lamps_have_the_light_and_the_colour_of_the_frame_that_measures_them(
    tint: tuple[float, ...], reference: int
) -> None:
    """Their sharp edges, mixed as a frame is displaced, are no other lighting either."""
    exposures, lamp = (1, 1 / 16), 8 * np.array(tint)
    shots, scenes = bracketed(
        exposures, lambda scene, spot: np.where(2 * spot % 1 > 0.5, lamp, scene), width=3000
    )
    merged = merge_burst(shots, _SETTINGS, reference=reference)
    assert [frame.reason for frame in merged.frames] == ["", ""]
    inside = scenes[reference].min(axis=2) > 4
    found = picture(merged, _SETTINGS)[minimum_filter(inside, 9)]
    assert found.mean(axis=0) == pytest.approx(lamp * exposures[reference], rel=0.03)


@pytest.mark.parametrize(("exposures", "seen"), [((1, 1, 1), False), ((1, 0.1, 1), True)])
def test_a_small_highlight_is_lost_unless_another_frame_has_seen_it(
    exposures: tuple[float, ...], seen: bool
) -> None:
    shots, _ = bracketed(exposures, lambda scene, spot: scene + 9.0 * spot, 4)
    merged = merge_burst(shots, _SETTINGS, reference=0)
    assert [frame.reason for frame in merged.frames] == [""] * 3
    assert (merged.lost[59:62, 68:71] > 200).all() != seen
    assert (merged.lost.max() < 60) == seen
