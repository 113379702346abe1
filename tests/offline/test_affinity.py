"""The four parity fields against their reference, and against what makes them affinities."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline.stages import affinity as stage
from panchroma.offline.stages.affinity import AffinitySettings, solve_affinities
from panchroma.shared import CfaPattern
from panchroma.shared.arrays import DoubleArray, FloatArray
from panchroma.shared.errors import ConvergenceError
from tests.offline.scenes import CASES, every_case, true_light
from tests.reference import affinity as reference
from tests.reference.compare import assert_close

# Conjugate gradients in float32 reach a relative residual of 1e-6 and no further; systems of this
# size magnify it about ten times.
TIGHT = AffinitySettings(tolerance=1e-6)
SOLVED = 5e-5
# What the residual of 1e-3 that a render asks for leaves in the affinities of such systems.
PAPER = AffinitySettings()
RENDERED = 0.03
# Four values of about one, each rounded to float32.
SUM = 5e-7
# What a halo of two patches leaves at most, for periods up to 8. The solver's tolerance of 1e-3
# leaves 0.1 and 1e-3.
CUT, CUT_RMS = 0.01, 5e-4


def expected(
    luminance: FloatArray, pattern: CfaPattern, scales: tuple[float, ...] = PAPER.scales
) -> DoubleArray:
    return reference.fields(luminance.astype(np.float64), pattern, scales)


@every_case
def test_equals_the_reference(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    light = true_light(pattern, shape)
    found = solve_affinities(light, pattern, TIGHT)
    assert found.dtype == np.float32
    assert_close(found, expected(light, pattern), SOLVED)
    rendered = solve_affinities(light, pattern, PAPER)
    assert_close(rendered, found.astype(np.float64), RENDERED)
    assert_close(rendered.sum(axis=(0, 1)), np.ones(rendered.shape[2:]), SUM)
    assert rendered.min() >= 0
    assert rendered.max() <= 1
    for (row, column), (i, j) in reference.pins(pattern, shape).items():
        assert rendered[i % 2, j % 2, row, column] == 1


@pytest.mark.parametrize("scales", [(0.5,), (1.5,), (0.4, 0.9, 2.0), (0.1,)])
def test_equals_the_reference_at_other_scales(scales: tuple[float, ...]) -> None:
    """At a tenth of a pixel the derivative reaches no neighbour: no edges at all."""
    pattern, shape = CASES["odd"]
    light = true_light(pattern, shape)
    assert_close(
        solve_affinities(light, pattern, AffinitySettings(scales, 1e-6)),
        expected(light, pattern, scales),
        SOLVED,
    )


@pytest.mark.parametrize("value", [0.0, 0.7, -1.0, 1e4])
def test_equals_the_reference_without_edges(value: float) -> None:
    pattern, shape = CASES["odd"]
    light = np.full(shape, value, np.float32)
    assert_close(solve_affinities(light, pattern, TIGHT), expected(light, pattern), SOLVED)


def test_blocks_that_differ_from_even_light_by_rounding_take_long_and_converge() -> None:
    """Such a step around every block is the strongest edge there is, and nearly cuts all light off
    from the blocks.
    """
    pattern, shape = CfaPattern.bayer(13), (400, 430)
    light = np.where(pattern.panchromatic_mask(shape), 2.4, 2.4 * (1 - 3e-7)).astype(np.float32)
    with pytest.raises(ConvergenceError, match=r"residual of .* after 500 iterations, short of 1"):
        solve_affinities(light, pattern, replace(PAPER, iterations=500))
    fields = solve_affinities(light, pattern, PAPER)
    assert_close(fields.sum(axis=(0, 1)), np.ones(fields.shape[2:]), SUM)


@pytest.mark.parametrize("period", [3, 6, 16])
@pytest.mark.parametrize("kind", ["noise", "impulses", "checkers", "rounding"])
def test_difficult_pictures_converge_in_the_papers_settings(kind: str, period: int) -> None:
    random = np.random.default_rng(8)
    shape = (50, 61)
    row, column = np.indices(shape)
    light = {
        "noise": random.normal(size=shape),
        "impulses": (random.uniform(size=shape) < 0.01) * 1.0,
        "checkers": (row + column) % 2 * 1.0,
        "rounding": 0.7 + 1e-7 * random.normal(size=shape),
    }[kind].astype(np.float32)
    found = solve_affinities(light, CfaPattern.bayer(period, origin=(1, 2)), PAPER)
    assert np.isfinite(found).all()
    assert_close(found.sum(axis=(0, 1)), np.ones(found.shape[2:]), SUM)


def test_shares_what_edges_cut_off_from_every_block() -> None:
    """Behind edges so strong that their weights all but vanish the solver must not leave a pixel
    where it started.
    """
    light = np.full((60, 60), 1.0, np.float32)
    light[:, :20], light[:, 20] = 0.0, 0.5
    pattern = CfaPattern.bayer(16)
    assert_close(solve_affinities(light, pattern, PAPER), expected(light, pattern), 0.05)


def test_solves_where_a_class_has_no_block() -> None:
    """One patch high, blocks one pixel high: those below the frame pin nothing."""
    pattern = CfaPattern.with_block(("RGB",), 6)
    light = true_light(pattern, (6, 40))
    assert_close(solve_affinities(light, pattern, TIGHT), expected(light, pattern), SOLVED)


def shaded_steps(shape: tuple[int, int]) -> FloatArray:
    """Shading, steps and noise."""
    random = np.random.default_rng(0)
    row, column = np.indices(shape)
    steps = 0.4 * (np.sin(row / 9.0) * np.cos(column / 13.0) > 0.2)
    light = 0.5 + steps + 0.1 * np.sin(row / 31.0) + random.normal(0, 0.02, shape)
    return light.astype(np.float32)


@pytest.mark.parametrize("period", [3, 4, 5, 6, 7, 8])
def test_small_chunks_equal_the_whole_frame(period: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Chunks of three patches: nine times as many borders as there will ever be."""
    monkeypatch.setattr(stage, "chunk_patches", lambda _: (3, 3))
    pattern = CfaPattern.bayer(period, origin=(period - 1, 1))
    light = shaded_steps((19 * period, 150 - 7 * period))
    result, exact = solve_affinities(light, pattern, TIGHT), expected(light, pattern)
    assert_close(result, exact, CUT)
    assert np.sqrt(np.mean((result - exact) ** 2)) < CUT_RMS
