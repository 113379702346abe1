import io
from collections.abc import Sequence

import numpy as np
import pytest

from panchroma.shared.arrays import DoubleArray, FloatArray
from panchroma.shared.errors import InputError
from panchroma.tools.evaluation.measures import PLANES, WINDOW, Histogram, Measures, window_origins
from panchroma.tools.evaluation.metrics import BORDER, CAP, QUANTILES, patch_psnr, psnr, quality
from tests.tools.evaluation.examples import pair

BIN = 0.0041  # dB: two bins, and rounding


def literal(rendered: FloatArray, truth: FloatArray, patch: int, border: int) -> DoubleArray:
    """The protocol, word by word: (3, rows, columns)."""
    height, width = truth.shape[:2]
    found = []
    for top in range(border, height - border - patch + 1):
        for left in range(border, width - border - patch + 1):
            a, b = (
                picture[top : top + patch, left : left + patch].astype(float)
                for picture in (rendered, truth)
            )
            a_luminance = a.sum(axis=2, keepdims=True) / 3
            b_luminance = b.sum(axis=2, keepdims=True) / 3
            pairs = ((a, b), (a_luminance, b_luminance), (a - a_luminance, b - b_luminance))
            found.append([10 * np.log10(1 / np.mean((x - y) ** 2)) for x, y in pairs])
    shape = (height - 2 * border - patch + 1, width - 2 * border - patch + 1, 3)
    return np.array(found).reshape(shape).transpose(2, 0, 1)


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


def test_pooled_quantiles_are_those_of_all_patches() -> None:
    """Frames differ in size: every patch counts once."""
    maps = [
        patch_psnr(*pair(rows, columns, seed))
        for rows, columns, seed in ((60, 70, 0), (44, 41, 1), (90, 50, 2))
    ]
    for plane in range(len(PLANES)):
        found = Histogram.pooled([Histogram.of(each[plane]) for each in maps]).quantiles()
        expected = np.quantile(np.concatenate([each[plane].ravel() for each in maps]), QUANTILES)
        np.testing.assert_allclose(found, expected, atol=BIN)


@pytest.mark.parametrize(
    ("decibels", "expected"),
    [([CAP], (CAP,) * 4), ([-1e6], (-100,) * 4), (range(101), (10, 25, 50, 75))],
)
def test_extremes_are_kept(decibels: Sequence[float], expected: tuple[float, ...]) -> None:
    assert Histogram.of(np.array(decibels, float)).quantiles() == pytest.approx(expected, abs=BIN)


def test_measures_come_back_from_the_cache_as_they_were() -> None:
    rendered, truth = pair()
    measures = Measures.of(rendered, truth)
    assert measures.quality == quality(rendered, truth)
    again = Measures.decode(measures.encode())
    assert (again.quality, again.psnr, again.wrong_hue) == (
        measures.quality,
        measures.psnr,
        measures.wrong_hue,
    )
    np.testing.assert_array_equal(again.errors, measures.errors)
    np.testing.assert_array_equal(again.hues, measures.hues)
    for ours, theirs in zip(again.patches, measures.patches, strict=True):
        assert ours.quantiles() == theirs.quantiles()
    # as files of ALGORITHM 37 hold it: the last figure is of hues, too
    with np.load(io.BytesIO(measures.encode())) as stored:
        fields, old = dict(stored), io.BytesIO()
    np.savez_compressed(old, **(fields | {"whole": np.append(fields["whole"], 0.5)}))
    assert Measures.decode(old.getvalue()).wrong_hue == measures.wrong_hue
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
            slice(start, min(start + WINDOW, size - BORDER))
            for start, size in zip((rows[i], columns[j]), shape, strict=True)
        )
        # float32
        assert found == pytest.approx(np.mean((rendered[inside] - truth[inside]) ** 2), rel=1e-4)
    assert rows[-1] == max(BORDER, shape[0] - BORDER - WINDOW)
