"""Clipped samples of a scene are white in its own white balance, without rings; and told."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

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
    quads = float(colour(dim.rgb).max())
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


BLACK, WHITE = 600, 16383


def exposed(limits: tuple[int, ...], noise: float = 0.0) -> tuple[CodeArray, NDArray[np.bool_]]:
    """RGGB samples of a bright sky, grey ground with a red lamp and hot pixels, seen through a
    lens that darkens the corners, with the noise of light; and which samples are clipped.

    limits: codes at which the four filters clip; noise: of the electronics after that, codes.
    """
    rng, (rows, columns) = np.random.default_rng(3), (160, 200)
    row, column = np.indices((rows, columns)) / np.reshape((rows, columns), (2, 1, 1))
    level = 0.05 + 2.4 / (1 + np.exp((row - 0.4 + 0.1 * column) / 0.07))
    light = level[..., None] * np.array(NEUTRAL)
    light[140:156, 40:160, 0] = 1.4  # a red lamp, below the limits of the other colours
    light *= (1 - 0.5 * ((row - 0.5) ** 2 + (column - 0.5) ** 2))[..., None]
    samples = np.empty((rows, columns))
    for site, (down, across) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        samples[down::2, across::2] = light[down::2, across::2, (0, 1, 1, 2)[site]]
    samples += rng.normal(0, 1, samples.shape) * np.sqrt(1e-5 * samples)
    codes, limit = BLACK + samples * (WHITE - BLACK), np.tile(np.reshape(limits, (2, 2)), (80, 100))
    clipped = codes >= limit
    codes = np.minimum(codes, limit) + noise * rng.normal(0, 1, codes.shape)
    codes[121, 61::50] = codes[130, 80::50] = WHITE  # hot pixels
    return np.rint(codes).clip(0, 65535).astype(np.uint16), clipped


@pytest.mark.parametrize("noise", [0, 6, 25])
@pytest.mark.parametrize(
    ("limits", "white"),
    [
        ((16383, 15783, 15783, 16383), WHITE),  # red and blue are multiplied
        ((14600, 15500, 15200, 16300), WHITE),
        ((15783, 15783, 15783, 15783), WHITE),
        ((16383, 15783, 15783, 16383), 15783),  # as some files state it: samples beyond, and noise
    ],
)
def test_colours_that_clip_at_codes_of_their_own_are_white_and_all_others_unchanged(
    tmp_path: Path, limits: tuple[int, ...], white: int, noise: float
) -> None:
    samples, clipped = exposed(limits, noise)
    levels = {50714: (SHORT, [BLACK]), 50717: (SHORT, [white])}
    fields = {**levels, 50728: (RATIONAL, rationals(NEUTRAL))}
    path = write_dng(tmp_path / "sky.dng", samples, fields=fields)
    scene = load_scene(path, registered=False)
    lost = clipped.reshape(80, 2, 100, 2).any(axis=(1, 3))
    assert 0.2 < lost.mean() < 0.8
    red, sky = colour(scene.rgb) > 0.1, np.indices(lost.shape)[0] < 65
    assert red[lost & ~sky].mean() > 0.9
    assert red[lost & sky].mean() < 0.003
    assert np.median(colour(scene.rgb)[lost & sky]) < 0.02
    far = ~maximum_filter(lost, 9)
    far &= samples.reshape(80, 2, 100, 2).max(axis=(1, 3)) < 0.9 * white
    signal = (samples - np.float32(BLACK)) / np.float32(white - BLACK)
    quads = [signal[::2, ::2], (signal[::2, 1::2] + signal[1::2, ::2]) / 2, signal[1::2, 1::2]]
    assert far.mean() > 0.1
    np.testing.assert_array_equal(scene.rgb[far], np.stack(quads, axis=2).clip(0)[far])


@pytest.mark.parametrize("spread", [60, 400])
def test_an_even_surface_that_is_the_brightest_of_its_colour_is_no_limit(spread: float) -> None:
    """It has the noise of light, or shading, and hot pixels may be above it."""
    rng = np.random.default_rng(5)
    ground, surface = rng.uniform(BLACK, 0.8 * WHITE, 50_000), rng.normal(0.9 * WHITE, spread, 5000)
    codes = np.rint(np.concatenate([ground, surface, np.full(5, WHITE)])).astype(np.uint16)
    assert saturation(codes, WHITE) == WHITE
    assert saturation(np.minimum(codes, np.uint16(0.9 * WHITE)), WHITE) == int(0.9 * WHITE)
