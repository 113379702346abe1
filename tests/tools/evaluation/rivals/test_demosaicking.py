"""DLMMSE, pixel by pixel as it is defined; bilinear interpolation up to the border, see also
test_network.
"""

from collections.abc import Callable

import numpy as np
import pytest

from panchroma.shared.arrays import FloatArray
from panchroma.tools.evaluation.rivals.bilinear import demosaic_bilinear
from panchroma.tools.evaluation.rivals.dlmmse import demosaic_dlmmse
from panchroma.tools.simulation.bayer import ORDER, sample_bayer

Demosaic = Callable[[FloatArray], FloatArray]


def green_of(mosaic: FloatArray, row: int, column: int) -> float:
    """Green at a red or blue site far from the border, word by word from sections II and III of the
    paper.
    """
    m = mosaic.astype(float)
    low_pass = np.array([4, 9, 15, 23, 26, 23, 15, 9, 4]) / 128

    def green(r: int, c: int) -> bool:
        return ORDER[r % 2 * 2 + c % 2] == "G"

    def value(n: int, step: tuple[int, int]) -> float:
        place = row + n * step[0], column + n * step[1]
        assert min(place) >= 0
        return float(m[place])

    # green minus the other colour of the line
    def difference(n: int, step: tuple[int, int]) -> float:
        middle = value(n, step)
        near, far = (value(n - by, step) + value(n + by, step) for by in (1, 2))
        other = near / 2 + (2 * middle - far) / 4
        return middle - other if green(row + n * step[0], column + n * step[1]) else other - middle

    estimates = []
    for step in ((0, 1), (1, 0)):
        y = {n: difference(n, step) for n in range(-8, 9)}
        smooth = {n: sum(low_pass[k + 4] * y[n + k] for k in range(-4, 5)) for n in range(-4, 5)}
        variance = np.var(list(smooth.values()), ddof=1)
        noise = np.mean([(smooth[n] - y[n]) ** 2 for n in range(-4, 5)]) + 0.1 / 255**2
        estimate = smooth[0] + variance / (variance + noise) * (y[0] - smooth[0])
        estimates.append((estimate, variance - variance**2 / (variance + noise) + 0.1 / 255**2))
    (h, h_error), (v, v_error) = estimates
    return float(m[row, column] + (h / h_error + v / v_error) / (1 / h_error + 1 / v_error))


def test_green_is_the_papers() -> None:
    mosaic = np.random.default_rng(5).random((30, 32)).astype(np.float32)
    picture = demosaic_dlmmse(mosaic)
    for row in range(11, 19):
        for column in range(12, 20):
            if ORDER[row % 2 * 2 + column % 2] != "G":
                expected = green_of(mosaic, row, column)
                assert picture[row, column, 1] == pytest.approx(expected, abs=1e-6)  # float32


@pytest.mark.parametrize("demosaic", [demosaic_bilinear, demosaic_dlmmse])
def test_measured_samples_stay(demosaic: Demosaic) -> None:
    mosaic = np.random.default_rng(1).random((18, 20)).astype(np.float32)
    np.testing.assert_array_equal(sample_bayer(demosaic(mosaic)), mosaic)
