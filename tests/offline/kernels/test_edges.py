"""What edges let through, against the literal e of Eq. 13."""

import numpy as np
import pytest

from offline.numerics.lanes import WIDTH
from offline.stages.affinity import derivative_filters, transmission
from shared.arrays import DoubleArray, FloatArray
from tests.offline.kernels.from_python import callable_kernel
from tests.reference import affinity as reference
from tests.reference.compare import assert_close

# Squares and quotients of float32 differences: parts in a million of values up to a hundred, of which exponentials are made.
FLOAT32 = 1e-5
SCALES = (0.5, 1.0)
TRANSMISSION = callable_kernel(transmission)


def through(area: DoubleArray, period: int, scales: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Horizontally and vertically, of whole patches."""
    filters = derivative_filters(scales)
    reach = filters[0].shape[1] - 1
    light = np.pad(np.pad(area.astype(np.float32), reach, mode="reflect"), ((0, 0), (0, 3 * WIDTH)))
    out = np.full((2, area.shape[0] + 2, area.shape[1] + 3 * WIDTH), -1, np.float32)
    TRANSMISSION(light, period, filters, out)
    assert (out[:, [0, -1]] == -1).all()
    across, down = out[:, 1:-1, WIDTH : WIDTH + area.shape[1]]
    return across, down


@pytest.mark.parametrize("scales", [SCALES, (0.4, 0.9, 2.0), (0.1,)])
@pytest.mark.parametrize(("period", "patches"), [(3, (1, 1)), (4, (5, 3)), (6, (4, 7)), (16, (2, 3))])
def test_equals_the_reference(period: int, patches: tuple[int, int], scales: tuple[float, ...]) -> None:
    area = np.random.default_rng(period).uniform(size=(patches[0] * period, patches[1] * period)) ** 3
    for axis, found in zip((1, 0), through(area, period, scales), strict=True):
        assert_close(found, np.exp(-reference.edges(area, period, scales, axis)), FLOAT32)


@pytest.mark.parametrize("value", [0.0, 0.7, -3.0, 1e4, 1e-30])
def test_lets_everything_through_where_nothing_changes(value: float) -> None:
    for found in through(np.full((12, 18), value), 6, SCALES):
        assert (found == 1).all()


def test_a_step_is_an_edge_in_one_direction() -> None:
    area = np.ones((12, 12))
    area[:, 9:] = 2.0
    across, down = through(area, 6, SCALES)
    assert across[:, 8:10].max() < 0.2
    assert (down == 1).all()
    assert (across[:, :5] > 0.99).all()
