"""Small scenes and sensors for the stages: all periods and phases, odd sizes, cut blocks, five
channels, scattered sites.
"""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline.frame import Frame
from panchroma.offline.stages.correction import fill_error
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import DoubleArray, FloatArray
from panchroma.tools.simulation.sensor import simulate_additive
from tests.reference.sensor import luminance_of, observe

CASES = {
    "paper": (CfaPattern.bayer(6), (24, 24)),
    "odd": (CfaPattern.bayer(6, "GRBG", (4, 5)), (23, 31)),
    "period 3": (CfaPattern.bayer(3, "GBRG", (2, 1)), (11, 14)),
    "period 4": (CfaPattern.bayer(4, "BGGR", (1, 3)), (13, 18)),
    "period 8": (CfaPattern.bayer(8, origin=(7, 3)), (29, 21)),
    "five channels": (CfaPattern.with_block(("RGB", "XWY"), 6, (2, 3)), (25, 20)),
    "one row": (CfaPattern.with_block(("RGB",), 5, (4, 3)), (17, 12)),
    "across the tile's edge": (CfaPattern(("BWWWG", "WWWWW", "WWWWW", "WWWWW", "GWWWR")), (16, 14)),
    "scattered": (CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (1, 2)), (17, 22)),
    "two blocks": (
        CfaPattern.of_letters("RGWWWW/GBWWWW/WWWWWW/WWWBGW/WWWGRW/WWWWWW", (4, 3)),
        (26, 21),
    ),
    "one block": (CfaPattern.bayer(6, origin=(2, 3)), (4, 5)),
}
every_case = pytest.mark.parametrize(("pattern", "shape"), CASES.values(), ids=list(CASES))

GAMMAS = (0.8, 1.1, 1.25, 0.9, 1.3)  # no two alike: a weight taken for another shows


def gamma_of(pattern: CfaPattern) -> tuple[float, ...]:
    return GAMMAS[: len(pattern.channels)]


def materials(shape: tuple[int, int], channels: int, seed: int = 0) -> DoubleArray:
    """A scene of a few materials with slanted borders, each shaded and textured; values about 0.05
    to 1.
    """
    random = np.random.default_rng(seed)
    row, column = np.indices(shape)
    is_below, is_right = row + 0.3 * column > shape[0] / 2, column - 0.4 * row > shape[1] / 3
    surfaces = is_below + 2 * is_right
    colours = random.uniform(0.2, 1.0, (4, channels))
    texture = random.uniform(-0.1, 0.1, shape)
    shading = 0.6 + 0.3 * np.sin(row / 5.0) * np.cos(column / 7.0) + texture
    return colours[surfaces] * shading[..., None]


def true_light(pattern: CfaPattern, shape: tuple[int, int]) -> FloatArray:
    """Luminance of `materials`: what panchromatic pixels read of them."""
    scene = materials(shape, len(pattern.channels))
    return luminance_of(scene, gamma_of(pattern)).astype(np.float32)


def photographed(
    scene: FloatArray, pattern: CfaPattern | None = None, sigma: float = 0.0, seed: int = 0
) -> Mosaic:
    """The shot of a scene, by default through the filters of the paper."""
    filters, random = pattern or CfaPattern.bayer(), np.random.default_rng(seed)
    return simulate_additive(scene, filters, SensorCalibration(filters.channels), sigma, random)


def shot(
    pattern: CfaPattern, shape: tuple[int, int], sigma: float | None = 0.02, seed: int = 0
) -> Mosaic:
    """A noisy mosaic of `materials`, whose calibration knows the noise."""
    scene, random = materials(shape, len(pattern.channels), seed), np.random.default_rng(seed + 1)
    noise = None if sigma is None else random.normal(scale=sigma, size=shape)
    return observe(scene, pattern, gamma_of(pattern), sigma, noise)


def cleaned(mosaic: Mosaic, clipping: float = np.inf) -> Frame:
    """The mosaic as it is: nothing is wrong with it."""
    return Frame(mosaic, clipping)


def sampled(mosaic: Mosaic, luminance: FloatArray, clipping: float = np.inf) -> Frame:
    """The same, with luminance."""
    frame = replace(cleaned(mosaic, clipping), luminance=luminance)
    return replace(frame, fill_error=fill_error(frame))
