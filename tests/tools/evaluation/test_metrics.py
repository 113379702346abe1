import numpy as np
import pytest

from shared.arrays import DoubleArray, FloatArray
from shared.errors import InputError
from tests.tools.evaluation.examples import pair
from tools.evaluation.metrics import CAP, QUANTILES, patch_psnr, psnr, quality


def literal(rendered: FloatArray, truth: FloatArray, patch: int, border: int) -> DoubleArray:
    """The protocol, word by word: (3, rows, columns)."""
    height, width = truth.shape[:2]
    found = []
    for top in range(border, height - border - patch + 1):
        for left in range(border, width - border - patch + 1):
            a, b = (picture[top : top + patch, left : left + patch].astype(float) for picture in (rendered, truth))
            a_luminance, b_luminance = a.sum(axis=2, keepdims=True) / 3, b.sum(axis=2, keepdims=True) / 3
            pairs = ((a, b), (a_luminance, b_luminance), (a - a_luminance, b - b_luminance))
            found.append([10 * np.log10(1 / np.mean((x - y) ** 2)) for x, y in pairs])
    shape = (height - 2 * border - patch + 1, width - 2 * border - patch + 1, 3)
    return np.array(found).reshape(shape).transpose(2, 0, 1)


@pytest.mark.parametrize(("rows", "columns", "patch", "border"), [(40, 43, 10, 15), (12, 17, 4, 2), (9, 8, 1, 0), (10, 10, 10, 0)])
def test_patches_follow_the_protocol(rows: int, columns: int, patch: int, border: int) -> None:
    rendered, truth = pair(rows, columns)
    expected = literal(rendered, truth, patch, border)
    for plane, reference in zip(patch_psnr(rendered, truth, patch, border), expected, strict=True):
        np.testing.assert_allclose(plane, reference, rtol=1e-11)  # float64 sums in another order


def test_quantiles_are_those_of_the_patches() -> None:
    rendered, truth = pair(50, 60)
    found = quality(rendered, truth)
    expected = np.quantile(literal(rendered, truth, 10, 15).reshape(3, -1), QUANTILES, axis=1).T
    np.testing.assert_allclose((found.rgb, found.luminance, found.chrominance), expected, rtol=1e-11)
    assert found.median == (found.rgb[2], found.luminance[2], found.chrominance[2])


def test_equal_pictures_score_the_cap_even_beside_a_gross_error() -> None:
    _, truth = pair(60, 60)
    assert quality(truth, truth).rgb == (CAP,) * 4
    assert psnr(truth, truth) == CAP
    spoiled = truth.copy()
    spoiled[16, 16] += 1e6  # running sums would carry its rounding into every patch after it
    assert patch_psnr(spoiled, truth).rgb[20:, 20:].min() == CAP


def test_the_border_is_left_out() -> None:
    rendered, truth = pair(60, 60)
    spoiled = rendered.copy()
    spoiled[:15] = spoiled[-15:] = 9
    spoiled[:, :15] = spoiled[:, -15:] = 9
    assert quality(spoiled, truth) == quality(rendered, truth)
    assert psnr(spoiled, truth, border=15) == psnr(rendered, truth, border=15)


def test_what_cannot_be_compared_is_refused() -> None:
    rendered, truth = pair(40, 40)
    with pytest.raises(InputError, match="at least 40 pixels"):
        patch_psnr(rendered[:39], truth[:39])
    with pytest.raises(InputError, match="shape"):
        patch_psnr(rendered[:, :-1], truth)
    with pytest.raises(InputError, match="shape"):
        psnr(rendered[..., 0], truth[..., 0])
    with pytest.raises(InputError, match="border of 20"):
        psnr(rendered, truth, border=20)
    rendered[0, 0, 0] = np.nan
    with pytest.raises(InputError, match="not finite"):
        patch_psnr(rendered, truth)
