from collections.abc import Sequence

import numpy as np
import pytest

from panchroma.shared.arrays import DoubleArray, FloatArray
from panchroma.shared.errors import InputError
from panchroma.tools.evaluation.metrics import (
    BORDER,
    CAP,
    WINDOW,
    Histogram,
    Measures,
    patch_psnr,
    psnr,
    quality,
    window_origins,
)
from tests.tools.evaluation.examples import pair


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
    assert quality(truth, truth).rgb == (CAP,) * 4
    assert psnr(truth, truth) == CAP
    spoiled = truth.copy()
    spoiled[16, 16] += 1e6  # running sums would carry its rounding into every patch after it
    assert patch_psnr(spoiled, truth).rgb[20:, 20:].min() == CAP


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
    quantiles = Histogram.of(np.array(decibels, float)).quantiles()
    assert quantiles == pytest.approx(expected, abs=0.0041)  # dB: two bins, and rounding


def test_measures_come_back_from_the_cache_as_they_were() -> None:
    rendered, truth = pair()
    measures = Measures.of(rendered, truth)
    assert measures.quality == quality(rendered, truth)
    again = Measures.decode(measures.encode())
    for name, value in vars(measures).items():
        np.testing.assert_equal(getattr(again, name), value)
    for data in (b"", b"PK\3\4 no archive", measures.encode()[:-40]):
        with pytest.raises(InputError, match="no result"):
            Measures.decode(data)


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
