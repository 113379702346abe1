"""Measure each kernel on one megapixel, with all threads:

pytest tests/benchmarks/kernels.py                                                     (not part of a plain `pytest`)
pytest tests/benchmarks/kernels.py --benchmark-autosave --benchmark-compare            compared with the previous run
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from offline import PAPER
from offline.kernels.functions import zeros
from offline.rows.affinity import solve_affinities
from offline.rows.propagation import propagate
from offline.rows.refinement import noise_level, refine
from offline.tiling import Band
from offline.whole.chromaticity import block_sums, estimate_chromaticities, oriented_medians, solve_constrained
from offline.whole.luminance import fill, recover_luminance
from shared.arrays import DoubleArray, FloatArray
from shared.mosaic import Mosaic
from tests.benchmarks.frame import Frame
from tests.offline.kernels.from_python import callable_kernel
from tests.offline.scenes import whole

Benchmark = Callable[..., object]


@dataclass(frozen=True, eq=False)
class Chain:
    """The inputs and outputs of the stages of one rendering."""

    mosaic: Mosaic
    luminance: FloatArray
    raw: DoubleArray
    blocks: FloatArray
    affinity: FloatArray
    initial: FloatArray
    band: Band


@pytest.fixture(scope="module")
def chain() -> Chain:
    mosaic = Frame.of(1.0).mosaic
    luminance = recover_luminance(mosaic, PAPER.luminance)
    weight, product, sigma = block_sums(mosaic, luminance, mosaic.pattern.grid(mosaic.shape))
    raw = solve_constrained(weight, product, sigma, np.array(mosaic.calibration.gamma))
    blocks = estimate_chromaticities(mosaic, luminance, PAPER.chromaticity)
    band = whole(mosaic.pattern, mosaic.shape)
    affinity = solve_affinities(luminance, mosaic.pattern, PAPER.affinity, band)
    initial = propagate(blocks, affinity, luminance, mosaic.pattern, PAPER.propagation, band)
    return Chain(mosaic, luminance, raw, blocks, affinity, initial, band)


def test_holes_of_isolated_blocks(benchmark: Benchmark, chain: Chain) -> None:
    benchmark(recover_luminance, chain.mosaic, PAPER.luminance)


def test_ten_iterations_of_any_holes(benchmark: Benchmark, chain: Chain) -> None:
    pattern = chain.mosaic.pattern
    holes = pattern.filter_map((pattern.period, chain.mosaic.shape[1])) < len(pattern.channels)
    thresholds = (2.0 ** (-np.arange(10) / 4)).astype(np.float32)
    benchmark(fill, chain.mosaic.signal, holes, thresholds)


def test_oriented_medians(benchmark: Benchmark, chain: Chain) -> None:
    benchmark(oriented_medians, chain.raw, PAPER.chromaticity.taps, PAPER.chromaticity.repetitions)


def test_harmonic_fields(benchmark: Benchmark, chain: Chain) -> None:
    benchmark(solve_affinities, chain.luminance, chain.mosaic.pattern, PAPER.affinity, chain.band)


def test_mixing(benchmark: Benchmark, chain: Chain) -> None:
    benchmark(propagate, chain.blocks, chain.affinity, chain.luminance, chain.mosaic.pattern, PAPER.propagation, chain.band)


def test_averaging(benchmark: Benchmark, chain: Chain) -> None:
    sigma = noise_level(chain.luminance, chain.mosaic)
    benchmark(refine, chain.initial, chain.luminance, chain.mosaic.pattern.period, sigma, PAPER.refinement, chain.band)


def test_fresh_memory(benchmark: Benchmark, chain: Chain) -> None:
    """A cost of every stage: a new plane of the frame's size, written once."""
    made = callable_kernel(zeros)
    benchmark(lambda: made(chain.luminance.size).fill(1))
