"""What the colour samples of a burst say about every pixel, against a direct solution."""

import numpy as np
import pytest

from offline.burst.spreading import HALO, spread_samples
from offline.burst.spreading import TOLERANCE as LIMIT
from offline.numerics.linked import TILE, tiles_of
from shared.arrays import ByteArray, DoubleArray, FloatArray, IndexArray
from tests.reference import burst as reference

TOLERANCE = 1e-2  # of the largest correction: conjugate gradients stop before
PRIOR = 0.15, 0.01, 0.03
MOST = 100  # iterations that uncertain samples take, which spread far


def basis(channels: int) -> DoubleArray:
    return np.linalg.qr(np.column_stack([np.ones(channels), np.eye(channels)[:, 1:]]))[0][:, 1:]


def picture(shape: tuple[int, int], channels: int) -> tuple[DoubleArray, DoubleArray, DoubleArray]:
    """Luminance with an edge, chromaticities, and gamma."""
    y, x = np.indices(shape)
    luminance = 1 + 0.01 * np.sin(y / 3) + (x > shape[1] // 2)
    gamma = np.linspace(0.8, 1.3, channels)
    return luminance, np.ones((*shape, channels)) / gamma.sum(), gamma


def samples(shape: tuple[int, int], channels: int, count: int) -> tuple[DoubleArray, IndexArray]:
    random = np.random.default_rng(0)
    places = random.uniform(0, 1, (count, 2)) * (np.array(shape) - 1)
    figures = np.column_stack(
        [places, random.uniform(0.1, 0.8, count), random.uniform(0.9, 2.1, count), random.uniform(0.1, 1, count)]
    )
    return figures, random.integers(0, channels, count)


def by_tile(figures: DoubleArray, channels: IndexArray, shape: tuple[int, int]) -> tuple[FloatArray, ByteArray, IndexArray]:
    across = -(-shape[1] // TILE)
    tile = (figures[:, :2] // TILE).astype(int) @ (across, 1)
    order = np.argsort(tile, kind="stable")
    starts = np.searchsorted(tile[order], np.arange(-(-shape[0] // TILE) * across + 1))
    return figures[order].astype(np.float32), channels[order].astype(np.uint8), starts


def spread(
    shape: tuple[int, int], channels: int, count: int, cut: int = 0, precision: float = 1.0
) -> tuple[FloatArray, DoubleArray]:
    """The corrected chromaticity, computed in one part or in two that meet at row `cut`; and the one before."""
    prior = PRIOR[0], PRIOR[1] * precision, PRIOR[2]
    luminance, chromaticity, gamma = picture(shape, channels)
    figures, of = samples(shape, channels, count)
    sorted_samples = by_tile(figures * [1, 1, 1, 1, precision], of, shape)
    planes = luminance.astype(np.float32), chromaticity.astype(np.float32)
    found = np.full(chromaticity.shape, np.nan, np.float32)
    for rows in ((0, cut), (cut, shape[0])) if cut else ((0, shape[0]),):
        first, last = max(rows[0] - HALO, 0), min(rows[1] + HALO, shape[0])
        light, colour = (np.ascontiguousarray(plane[first:last]) for plane in planes)
        out = np.empty((rows[1] - rows[0], shape[1], channels), np.float32)
        weights = gamma.astype(np.float32), np.ascontiguousarray(basis(channels), np.float32)
        residuals, used = np.full(tiles_of(rows, shape[1]), np.nan), np.zeros(tiles_of(rows, shape[1]), np.intp)
        spread_samples(light, colour, first, rows, shape[0], sorted_samples, *weights, prior, out, residuals, used)
        assert (residuals <= LIMIT).all()
        assert (used <= MOST).all()
        found[slice(*rows)] = out
    return found, chromaticity


@pytest.mark.parametrize(
    ("channels", "shape", "count"),
    [(2, (18, 22), 150), (3, (18, 22), 150), (5, (18, 22), 150), (2, (TILE + 8, 9), 250), (2, (9, TILE + 8), 250)],
)
def test_equals_a_direct_solution(channels: int, shape: tuple[int, int], count: int) -> None:
    found, before = spread(shape, channels, count)
    luminance, _, gamma = picture(shape, channels)
    expected = reference.spread(luminance, before, samples(shape, channels, count), gamma, basis(channels), PRIOR)
    assert np.abs(found - expected).max() < TOLERANCE * np.abs(expected - before).max()
    assert np.allclose((found * gamma).sum(axis=2), 1, atol=1e-5)  # luminance stays


def test_parts_leave_no_trace() -> None:
    whole, parts = (spread((TILE + 40, TILE + 30), 3, 4000, cut)[0] for cut in (0, TILE))
    assert np.array_equal(whole, parts)


def test_nothing_changes_without_samples() -> None:
    found, before = spread((20, 30), 3, 0)
    assert np.array_equal(found, before.astype(np.float32))


@pytest.mark.parametrize("precision", [1e-2, 1e-4])
def test_samples_in_noise_are_solved_too(precision: float) -> None:
    """What they say spreads far: without a coarse level the solver stopped on its way there."""
    shape, channels, count, prior = (40, 44), 3, 300, (PRIOR[0], PRIOR[1] * precision, PRIOR[2])
    found, before = spread(shape, channels, count, precision=precision)
    luminance, _, gamma = picture(shape, channels)
    figures, of = samples(shape, channels, count)
    uncertain = figures * [1, 1, 1, 1, precision]
    expected = reference.spread(luminance, before, (uncertain, of), gamma, basis(channels), prior)
    assert np.abs(found - expected).max() < TOLERANCE * np.abs(expected - before).max()


def test_a_large_picture_in_noise_takes_no_more_iterations() -> None:
    spread((2 * TILE, 2 * TILE), 3, 4000, precision=1e-4)
