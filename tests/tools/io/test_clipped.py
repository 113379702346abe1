"""Clipped samples of a scene are white in its own white balance, without rings; and told."""

from pathlib import Path

import numpy as np
import pytest

from panchroma.shared.arrays import CodeArray, FloatArray
from panchroma.tools.io.clipped import saturation, with_white_highlights
from panchroma.tools.io.scene import Scene
from panchroma.tools.simulation.load import load_scene
from tests.tools.io.files import RATIONAL, SHORT, rationals, write_dng

NEUTRAL = (0.5, 1.0, 0.625)
TOP = 4000


def lamp(peak: float, shape: tuple[int, int] = (80, 90), width: float = 8) -> FloatArray:
    """What white reads of a soft light on a dim wall, (H, W, 3)."""
    row, column = np.indices(shape) - np.array(shape)[:, None, None] // 2
    level = 0.2 + peak * np.exp(-(row**2 + column**2) / (2 * width**2))
    return np.asarray(level[..., None] * np.array(NEUTRAL), np.float32)


def bayer(light: FloatArray, limit: int = TOP) -> CodeArray:
    """RGGB samples of light, each at a place of its own, clipped. limit: the code at which they
    are.
    """
    samples = np.empty(light.shape[:2])
    for row, column, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        samples[row::2, column::2] = light[row::2, column::2, channel]
    return (samples * TOP).clip(0, limit).astype(np.uint16)


def colour(rgb: FloatArray) -> FloatArray:
    """How far each pixel is from grey once balanced, 0 to 1."""
    balanced = rgb / np.array(NEUTRAL, np.float32)
    return np.asarray(np.ptp(balanced, axis=2) / balanced.max(axis=2))


def raw(path: Path, samples: CodeArray) -> Scene:
    fields = {50714: (SHORT, [0]), 50717: (SHORT, [TOP]), 50728: (RATIONAL, rationals(NEUTRAL))}
    return load_scene(write_dng(path, samples, fields=fields), registered=False)


@pytest.mark.parametrize(("width", "limit"), [(2, TOP), (2, 3600), (8, 3600), (20, TOP)])
def test_a_burnt_out_lamp_is_white_without_a_ring(tmp_path: Path, width: float, limit: int) -> None:
    """Also where the sensor saturates below the white level that the file states."""
    light = lamp(6, (160, 180), width)
    scene = raw(tmp_path / "lamp.dng", bayer(light, limit))
    dim = raw(tmp_path / "dim.dng", bayer(light / np.float32(8)))
    clipped = (light * TOP >= limit).any(axis=2).reshape(80, 2, 90, 2).any(axis=(1, 3))
    assert clipped.sum() > 5
    # The samples of a quad lie side by side: so much colour has a lamp that is not clipped.
    quads = colour(dim.rgb).max()
    assert colour(scene.rgb)[clipped].max() <= max(quads, 0.05)
    assert colour(scene.rgb).max() <= max(1.1 * quads, 0.08)
    assert np.median(scene.rgb[clipped][:, 1]) > 0.9 * limit / TOP
    assert any("clipped in the file: they are taken for white" in note for note in scene.notes)


def test_a_saturated_colour_that_clips_in_one_channel_keeps_its_colour() -> None:
    red = np.full((12, 12, 3), (1.0, 0.2, 0.1), np.float32)
    found, notes = with_white_highlights(red, NEUTRAL)
    np.testing.assert_array_equal(found, red)
    assert len(notes) == 1
    assert with_white_highlights(red, None)[0] is red  # nobody knows what white is


def test_saturation_is_the_code_that_many_samples_have() -> None:
    rng = np.random.default_rng(0)
    codes = rng.integers(0, 3000, 100_000).astype(np.uint16)
    many = np.arange(3500, 3900, dtype=np.uint16).repeat(200)
    assert saturation(codes, TOP) == TOP
    spike = np.append(np.full(500, 3700, np.uint16), np.uint16(4000))
    assert saturation(np.concatenate([codes, spike]), TOP) == 3700
    assert saturation(np.concatenate([codes, many, np.full(60, many[-1])]), TOP) == TOP
