"""A Bayer camera with additive noise."""

import numpy as np

from panchroma.shared.arrays import FloatArray
from panchroma.tools.simulation.bayer import sample_bayer
from panchroma.tools.simulation.protocols import PaperProtocol


def bayer_mosaic(rgb: FloatArray, sigma: float, rng: np.random.Generator) -> FloatArray:
    """Its samples, float32 (H, W), scene units, not clipped, of a scene (H, W, 3)."""
    return PaperProtocol(sigma).bayer(sample_bayer(rgb), rng).samples
