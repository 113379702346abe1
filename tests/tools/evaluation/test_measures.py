"""Hues that are wrong, and colour that fades: what the eye sees, whatever light and exposure."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from panchroma.shared import DoubleArray, FloatArray, InputError
from panchroma.shared.colorimetry import SRGB_TO_XYZ
from panchroma.shared.white_balance import shades_of_grey
from panchroma.tools.evaluation.metrics import (
    BORDER,
    CAP,
    WINDOW,
    Measures,
    colour_kept,
    colour_slopes,
    histogram,
    patch_psnr,
    pooled_quantiles,
    psnr,
    quality,
    window_origins,
    wrong_hue,
)
from panchroma.tools.io.colour import delta_e_2000, xyz_to_lab
from tests.tools.evaluation.examples import pair

# --- measures -------------------------------------------------------------------------------------


def literal(rendered: FloatArray, truth: FloatArray, patch: int, border: int) -> DoubleArray:
    """The protocol, word by word: (3, rows, columns)."""
    height, width = truth.shape[:2]
    psnrs = np.empty((3, height - 2 * border - patch + 1, width - 2 * border - patch + 1))
    for row, column in np.ndindex(psnrs.shape[1:]):
        top, left = row + border, column + border
        window = slice(top, top + patch), slice(left, left + patch)
        a, b = rendered[window].astype(float), truth[window].astype(float)
        grey_a, grey_b = (square.sum(axis=2, keepdims=True) / 3 for square in (a, b))
        pairs = ((a, b), (grey_a, grey_b), (a - grey_a, b - grey_b))
        psnrs[:, row, column] = [10 * np.log10(1 / np.mean((x - y) ** 2)) for x, y in pairs]
    return psnrs


@pytest.mark.parametrize(
    ("rows", "columns", "patch", "border"),
    [(40, 43, 10, 15), (12, 17, 4, 2), (9, 8, 1, 0), (10, 10, 10, 0)],
)
def test_patches_follow_the_protocol(rows: int, columns: int, patch: int, border: int) -> None:
    rendered, truth = pair(rows, columns)
    expected = literal(rendered, truth, patch, border)
    for plane, reference in zip(patch_psnr(rendered, truth, patch, border), expected, strict=True):
        np.testing.assert_allclose(plane, reference, rtol=1e-11)  # float64 sums in another order


def test_equal_pictures_score_the_cap_even_beside_a_gross_error() -> None:
    _, truth = pair(60, 60)
    assert (quality(truth, truth) == CAP).all()
    assert psnr(truth, truth) == CAP
    spoiled = truth.copy()
    spoiled[16, 16] += 1e6  # running sums would carry its rounding into every patch after it
    assert patch_psnr(spoiled, truth)[0][20:, 20:].min() == CAP


def test_what_cannot_be_compared_is_refused() -> None:
    rendered, truth = pair(40, 40)
    spoiled = rendered.copy()
    spoiled[0, 0, 0] = np.nan
    for words, function, pictures in (
        ("at least 40 pixels", patch_psnr, (rendered[:39], truth[:39])),
        ("shape", patch_psnr, (rendered[:, :-1], truth)),
        ("shape", psnr, (rendered[..., 0], truth[..., 0])),
        ("border of 20", psnr, (rendered, truth, 20)),
        ("not finite", patch_psnr, (spoiled, truth)),
    ):
        with pytest.raises(InputError, match=words):
            function(*pictures)


@pytest.mark.parametrize(
    ("decibels", "expected"),
    [([CAP], (CAP,) * 4), ([-1e6], (-100,) * 4), (range(101), (10, 25, 50, 75))],
)
def test_extremes_are_kept(decibels: Sequence[float], expected: tuple[float, ...]) -> None:
    quantiles = pooled_quantiles([histogram(np.array(decibels, float))])
    assert quantiles == pytest.approx(expected, abs=0.0041)  # dB: two bins, and rounding


def test_measures_come_back_from_the_cache_as_they_were() -> None:
    rendered, truth = pair()
    measures = Measures.of(rendered, truth)
    again = Measures.decode(measures.encode())
    for name, value in vars(measures).items():
        np.testing.assert_equal(getattr(again, name), value)


@pytest.mark.parametrize("shape", [(60, 70), (150, 126), (127, 301)])
def test_square_errors_are_those_of_the_squares(shape: tuple[int, int]) -> None:
    rendered, truth = pair(*shape)
    errors = Measures.of(rendered, truth).errors
    rows, columns = (window_origins(size) for size in shape)
    assert errors.shape == (len(rows), len(columns))
    square = np.square(rendered - truth)[: shape[0] - BORDER, : shape[1] - BORDER]
    for (i, j), error in np.ndenumerate(errors):
        window = square[rows[i] : rows[i] + WINDOW, columns[j] : columns[j] + WINDOW]
        assert error == pytest.approx(window.mean(), rel=1e-4)  # float32
    assert rows[-1] == max(BORDER, shape[0] - BORDER - WINDOW)


# --- hue ------------------------------------------------------------------------------------------

RNG = np.random.default_rng(3)


@pytest.mark.parametrize("exposure", [0.05, 1.0])
def test_it_is_ten_of_ciede2000_on_a_balanced_picture(exposure: float) -> None:
    """Written out for muted colours: grey mean, 99 % of luminance below 0.9, clipped."""
    light = np.array((0.5, 1.0, 0.7), np.float32) * np.float32(exposure)
    truth = (0.3 + 0.1 * RNG.random((70, 80, 3))).astype(np.float32) * light
    rendered = truth + np.float32(0.03 * exposure) * RNG.standard_normal(truth.shape, np.float32)
    to_xyz = np.array(SRGB_TO_XYZ)
    mean = truth.mean(axis=(0, 1), dtype=np.float64)
    balanced = [picture.astype(np.float64) / mean for picture in (rendered, truth)]
    white = np.quantile((balanced[1] @ to_xyz.T)[..., 1], 0.99) / 0.9
    first, second = (xyz_to_lab(np.clip(picture / white, 0, 1) @ to_xyz.T) for picture in balanced)
    difference = delta_e_2000(first, second)
    clear = abs(difference - 10) > 1e-3  # single precision
    assert (wrong_hue(rendered, truth) == (difference > 10))[clear].all()
    assert 0.05 < wrong_hue(rendered, truth).mean() < 0.95
    assert not wrong_hue(0 * truth, 0 * truth).any()  # black


def patches(light: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> FloatArray:
    """Coloured patches that grow brighter to the right, float32 (150, 300, 3)."""
    colours = gaussian_filter(RNG.random((150, 300, 3)), (10, 10, 0))
    colours = 1 + 3 * (colours - colours.mean(axis=(0, 1))) / colours.std()
    brighter = np.linspace(0.05, 0.5, 300)[:, None]
    return (brighter * np.clip(colours, 0.1, 8) / 4 * light).astype(np.float32)


def faded(truth: FloatArray, kept: FloatArray | float) -> FloatArray:
    """The scene with a part of its colour kept: balanced, mixed with its luminance, and back."""
    white = np.array(shades_of_grey(truth))
    balanced = truth / white
    grey = balanced.mean(axis=2, keepdims=True)
    return ((grey + kept * (balanced - grey)) * white).astype(np.float32)


def slopes(rendered: FloatArray, truth: FloatArray) -> DoubleArray:
    return colour_slopes(colour_kept(rendered, truth))[0]


@pytest.mark.parametrize("light", [(1.0, 1.0, 1.0), (0.5, 1.0, 0.6)])
def test_the_part_that_is_kept_in_every_bin(light: tuple[float, float, float]) -> None:
    truth = patches(light)
    np.testing.assert_allclose(slopes(faded(truth, 0.7), truth), 0.7, rtol=1e-4)


def test_noise_fades_nothing_and_grey_has_no_slope() -> None:
    truth = patches()
    noisy = truth + RNG.normal(0, 0.03, truth.shape).astype(np.float32)
    np.testing.assert_allclose(slopes(noisy, truth), 1, atol=0.03)
    assert np.isnan(slopes(truth, np.repeat(truth[..., :1], 3, axis=2))).all()


def test_the_standard_error_is_the_scatter_of_the_slopes() -> None:
    """Pictures of one kind, each with false colour of its own, of one picture and of four together:
    three tests in the darkest bin, where colour is least, and two in the brightest.
    """
    sums = []
    for seed in range(60):
        random = np.random.default_rng(seed)
        colours = gaussian_filter(random.normal(0, 1, (270, 390, 3)), (10, 10, 0))
        false = gaussian_filter(random.normal(0, 1, (270, 390, 3)), (12, 12, 0))
        light = np.linspace(0.1, 0.6, 390)[:, None]
        scene = light * (1 + 0.3 * colours / colours.std())
        picture = scene + light * 0.1 * false / false.std()
        sums.append(colour_kept(picture.astype(np.float32), scene.astype(np.float32)))
    for together in (1, 4):
        pooled = [np.sum(sums[i : i + together], axis=0) for i in range(0, 60, together)]
        found, errors = np.stack([colour_slopes(each) for each in pooled], axis=1)
        np.testing.assert_allclose(errors.mean(axis=0), found.std(axis=0), rtol=0.5)


def test_a_bin_with_hardly_any_colour_has_no_figure() -> None:
    """A tail-light in a grey night: it is no picture of how colour is kept in the dark."""
    night = np.full((240, 300, 3), 0.05, np.float32) + np.linspace(0, 0.3, 300)[:, None]
    lamp, wide = (night.astype(np.float32) for _ in range(2))
    lamp[114:117, 20:23] += np.array([0.3, -0.04, -0.04], np.float32)
    wide[40:200, 15:33] *= np.array([1.8, 0.6, 0.6], np.float32)
    assert 0 < colour_kept(lamp, lamp)[-2, 0] < 0.05 * colour_kept(lamp, lamp)[-1, 0]
    assert np.isnan(slopes(lamp, lamp)).all()
    assert slopes(wide, wide)[0] == pytest.approx(1)
    # of both, as of any number of pictures, all pixels count
    assert np.isnan(colour_slopes(colour_kept(wide, wide) + 30 * colour_kept(lamp, lamp))[0]).all()


def test_one_place_with_colour_has_a_slope_without_an_error() -> None:
    dark = np.full((90, 90, 3), 0.1, np.float32)
    dark[20:60, 20:60] *= np.array([1.8, 0.6, 0.6], np.float32)
    found, errors = colour_slopes(colour_kept(faded(dark, 0.5), dark))
    assert np.nanmin(found) == pytest.approx(0.5, abs=1e-3)
    assert np.isnan(errors[np.isnan(found)]).all()
