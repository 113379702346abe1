import numpy as np
import pytest

from shared.errors import InputError
from tests.tools.evaluation.examples import pair
from tools.evaluation.measures import PLANES, WINDOW, Histogram, Measures, window_origins
from tools.evaluation.metrics import BORDER, CAP, QUANTILES, patch_psnr, quality, ssim

BIN = 0.0021  # dB: a bin, and rounding


def test_pooled_quantiles_are_those_of_all_patches() -> None:
    """Frames differ in size: every patch counts once."""
    maps = [patch_psnr(*pair(rows, columns, seed)) for rows, columns, seed in ((60, 70, 0), (44, 41, 1), (90, 50, 2))]
    for plane in range(len(PLANES)):
        found = Histogram.pooled([Histogram.of(each[plane]) for each in maps]).quantiles()
        expected = np.quantile(np.concatenate([each[plane].ravel() for each in maps]), QUANTILES)
        np.testing.assert_allclose(found, expected, atol=BIN)


def test_extremes_are_kept() -> None:
    assert Histogram.of(np.array([CAP])).quantiles() == (CAP,) * 4
    assert Histogram.of(np.array([-1e6])).quantiles() == pytest.approx((-100,) * 4, abs=BIN)
    assert Histogram.of(np.arange(101.0)).quantiles() == pytest.approx((10, 25, 50, 75), abs=BIN)


def test_measures_come_back_from_the_cache_as_they_were() -> None:
    rendered, truth = pair()
    measures = Measures.of(rendered, truth)
    assert measures.quality == quality(rendered, truth)
    again = Measures.decode(measures.encode())
    assert (again.quality, again.psnr, again.ssim, again.wrong_hue) == (
        measures.quality,
        measures.psnr,
        measures.ssim,
        measures.wrong_hue,
    )
    np.testing.assert_array_equal(again.errors, measures.errors)
    np.testing.assert_array_equal(again.hues, measures.hues)
    for ours, theirs in zip(again.patches, measures.patches, strict=True):
        assert ours.quantiles() == theirs.quantiles()
    for data in (b"", b"PK\3\4 no archive", measures.encode()[:-40]):
        with pytest.raises(InputError, match="no result"):
            Measures.decode(data)


@pytest.mark.parametrize("shape", [(60, 70), (150, 126), (127, 301)])
def test_square_errors_are_those_of_the_squares(shape: tuple[int, int]) -> None:
    rendered, truth = pair(*shape)
    errors = Measures.of(rendered, truth).errors
    rows, columns = (window_origins(size) for size in shape)
    assert errors.shape == (len(rows), len(columns))
    for (i, j), found in np.ndenumerate(errors):
        inside = tuple(
            slice(start, min(start + WINDOW, size - BORDER)) for start, size in zip((rows[i], columns[j]), shape, strict=True)
        )
        assert found == pytest.approx(np.mean((rendered[inside] - truth[inside]) ** 2), rel=1e-4)  # float32
    assert rows[-1] == max(BORDER, shape[0] - BORDER - WINDOW)


def test_ssim_is_the_papers() -> None:
    """A literal window by window sum of Wang et al., Eqs. 13 to 17, on a small picture."""
    a, b = pair(18, 16)
    steps = np.arange(-5, 6)
    weights = np.exp(-(steps[:, None] ** 2 + steps**2) / (2 * 1.5**2))
    weights /= weights.sum()
    found = []
    for channel in range(3):
        for row in range(2 + 5, 18 - 2 - 5):
            for column in range(2 + 5, 16 - 2 - 5):
                x, y = (each[row - 5 : row + 6, column - 5 : column + 6, channel].astype(float) for each in (a, b))
                mean_x, mean_y = (weights * x).sum(), (weights * y).sum()
                var_x, var_y = (weights * (x - mean_x) ** 2).sum(), (weights * (y - mean_y) ** 2).sum()
                covariance = (weights * (x - mean_x) * (y - mean_y)).sum()
                above = (2 * mean_x * mean_y + 0.01**2) * (2 * covariance + 0.03**2)
                found.append(above / ((mean_x**2 + mean_y**2 + 0.01**2) * (var_x + var_y + 0.03**2)))
    assert ssim(a, b, border=2) == pytest.approx(np.mean(found), rel=1e-9)


def test_ssim_of_equal_pictures_is_one_and_needs_a_window() -> None:
    a, b = pair(20, 20)
    assert ssim(a, a) == pytest.approx(1, abs=1e-12)
    with pytest.raises(InputError, match="11 x 11"):
        ssim(a, b, border=5)
    with pytest.raises(InputError, match="shape"):
        ssim(a, b[:-1])
