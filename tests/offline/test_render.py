"""The page as a whole: equal to the reference, and nothing on it idle."""

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import fields, replace
from inspect import isfunction
from typing import Any

import numpy as np
import pytest

from offline import BEST, PAPER, RenderSettings, SolverLog, render, render_bands
from offline.settings import AffinitySettings, ChromaticitySettings, LuminanceSettings, PoolingPass
from offline.sites import SiteSamples, site_samples, unclipped_blocks
from offline.tiling import Band
from shared import CfaPattern, Mosaic
from shared.arrays import FloatArray
from shared.errors import ConvergenceError
from shared.progress import Progress
from shared.sensor import simulate_additive
from tests.offline.scenes import CASES, every_case, gamma_of, materials, shot
from tests.reference import render as reference
from tests.reference.compare import assert_close
from tests.reference.sensor import luminance_of, observe

PAGE = sys.modules[render.__module__]  # `offline.render` names the function

# All stages in float32, the affinities solved as far as that goes: the luminance's rounding (5e-5) leads.
FLOAT32 = 5e-5
TIGHT = replace(PAPER, affinity=AffinitySettings(tolerance=1e-6))
TIGHT_BEST = replace(BEST, affinity=TIGHT.affinity, learned=PAPER.learned)  # the reference has learned nothing
# Luminance 5e-5 off moves the weights of pooling, whose exponents it is divided by the noise in.
DENOISED = 1e-3
# The affinities solved to a residual of 1e-3, as a render asks for: a single pixel may be off by a hundredth, the picture is not.
RENDERED, RENDERED_RMS = 2e-2, 1e-3
# What hole filling leaves after its last iteration is of the size of the last threshold; the corner of a frame is the worst place.
FILLED = PAPER.luminance.threshold * PAPER.luminance.decay ** (PAPER.luminance.iterations - 1)
# Rounding does not move a picture as far as this; every setting and stage does.
SEEN = 1e-4


@every_case
@pytest.mark.parametrize("sigma", [None, 0.02])
def test_equals_the_reference(pattern: CfaPattern, shape: tuple[int, int], sigma: float | None) -> None:
    mosaic = shot(pattern, shape, sigma)
    expected = reference.render(mosaic, PAPER)
    found = render(mosaic, TIGHT)
    assert {array.dtype for array in (found.rgb, found.luminance, found.chromaticity)} == {np.dtype(np.float32)}
    assert_close(found.luminance, expected.luminance, FLOAT32)
    assert_close(found.chromaticity, expected.chromaticity, FLOAT32)
    assert_close(found.rgb, expected.rgb, FLOAT32)
    rendered = render(mosaic, PAPER).rgb
    assert_close(rendered, expected.rgb, RENDERED)
    assert np.sqrt(np.mean((rendered - expected.rgb) ** 2)) < RENDERED_RMS


@every_case
def test_best_equals_the_reference(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    mosaic = shot(pattern, shape, 0.05)
    expected = reference.render(mosaic, BEST)
    found = render(mosaic, TIGHT_BEST)
    assert_close(found.luminance, expected.luminance, FLOAT32)
    assert_close(found.chromaticity, expected.chromaticity, DENOISED)
    assert_close(found.rgb, expected.rgb, DENOISED)


@pytest.mark.parametrize("case", ["odd", "five channels"])
def test_equals_the_reference_from_sensor_codes(case: str) -> None:
    mosaic = shot(*CASES[case])
    coded = Mosaic(mosaic.codes, mosaic.pattern, mosaic.calibration)
    assert_close(render(coded, TIGHT).rgb, reference.render(coded, PAPER).rgb, FLOAT32)


@every_case
def test_output_is_chromaticity_times_luminance_and_keeps_the_samples(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    mosaic = shot(pattern, shape)
    found = render(mosaic, PAPER)
    assert np.array_equal(found.rgb, found.chromaticity * found.luminance[..., None])  # Eq. 17
    measured = pattern.panchromatic_mask(shape)
    assert np.array_equal(found.luminance[measured], mosaic.signal[measured])
    # Eq. 7 holds for what comes out: seen by the same sensor, panchromatic pixels read what they read.
    again = luminance_of(found.rgb.astype(np.float64), mosaic.calibration.gamma)
    assert_close(again, found.luminance, 1e-5)


@every_case
def test_a_flat_scene_returns_from_simulation_as_it_was(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    calibration = observe(np.ones((*shape, len(pattern.channels))), pattern, gamma_of(pattern)).calibration
    colour = np.linspace(0.1, 1.0, len(pattern.channels), dtype=np.float32)
    scene = np.broadcast_to(colour, (*shape, len(colour)))
    mosaic = simulate_additive(scene, pattern, calibration, 0.0, np.random.default_rng(0))
    found = render(mosaic, PAPER)
    assert_close(found.rgb, scene, FILLED)
    measured = pattern.panchromatic_mask(shape)
    interior = np.zeros(shape, bool)
    interior[4:-4, 4:-4] = True
    assert_close(found.rgb[measured & interior], scene[measured & interior], 2e-5)


def test_the_simulated_sensor_is_the_references() -> None:
    for pattern, shape in CASES.values():
        scene = materials(shape, len(pattern.channels))
        expected = observe(scene, pattern, gamma_of(pattern))
        found = simulate_additive(scene.astype(np.float32), pattern, expected.calibration, 0.0, np.random.default_rng(0))
        assert_close(found.signal, expected.signal, 1e-6)


@pytest.mark.parametrize("sigma", [None, 0.0, 0.05])
def test_a_black_scene_stays_black(sigma: float | None) -> None:
    pattern, shape = CASES["odd"]
    found = render(observe(np.zeros((*shape, 3)), pattern, gamma_of(pattern), sigma), PAPER)
    assert not found.rgb.any()
    assert np.isfinite(found.chromaticity).all()


@pytest.mark.parametrize("scale", [1e-2, 1e3])
def test_units_do_not_matter_but_to_the_first_threshold(scale: float) -> None:
    """Everything else is a ratio: with threshold, floor and noise in the same unit the picture is the same."""
    mosaic = shot(*CASES["odd"], sigma=None)
    scaled = Mosaic(mosaic.signal * np.float32(scale), mosaic.pattern, mosaic.calibration)
    settings = replace(
        TIGHT,
        luminance=replace(PAPER.luminance, threshold=scale),
        refinement=replace(PAPER.refinement, floor=PAPER.refinement.floor * scale),
    )
    found = render(scaled, settings)
    assert_close(found.rgb / np.float32(scale), render(mosaic, TIGHT).rgb, FLOAT32)


def test_the_same_mosaic_gives_the_same_bytes() -> None:
    mosaic = shot(*CASES["odd"])
    before = mosaic.signal.copy()
    assert np.array_equal(render(mosaic, PAPER).rgb, render(mosaic, PAPER).rgb)
    assert np.array_equal(mosaic.signal, before)


def test_the_presets() -> None:
    assert RenderSettings() == PAPER
    assert (PAPER.denoising.strength, PAPER.pooling.passes, PAPER.noise.estimate) == (0, (), False)
    assert PAPER.luminance.iterations == 50
    assert PAPER.luminance.decay == 2**-0.25
    assert PAPER.chromaticity.taps == 5
    assert PAPER.refinement.strength == 40
    mosaic = shot(*CASES["odd"])
    assert np.array_equal(render(mosaic).rgb, render(mosaic, BEST).rgb)


class Listener(Progress):
    """Notes what it is told."""

    def __init__(self) -> None:
        self.steps: dict[str, int] = {}
        self.done: Counter[str] = Counter()
        self.parts: list[str] = []

    def stage(self, name: str, steps: int) -> None:
        assert name not in self.steps
        self.steps[name] = steps

    def advance(self, steps: int = 1) -> None:
        self.done[list(self.steps)[-1]] += steps

    def part(self, name: str) -> None:
        self.parts.append(name)


def test_progress_is_reported_stage_by_stage() -> None:
    listener = Listener()
    mosaic = shot(*CASES["odd"])
    assert np.array_equal(render(mosaic, PAPER, listener).rgb, render(mosaic, PAPER).rgb)
    assert list(listener.steps) == ["luminance", "chromaticity", "colour"]
    assert listener.parts == ["affinity", "propagation", "refinement"] * listener.steps["colour"]
    assert listener.done["luminance"] == listener.steps["luminance"]
    assert listener.done["colour"] == listener.steps["colour"]
    assert all(0 < listener.done[name] <= steps for name, steps in listener.steps.items())


@pytest.mark.parametrize("case", ["paper", "period 3"])
def test_solvers_say_what_they_did(case: str) -> None:
    """As often as they were asked to, or until nothing was left to do; the same for bands, of which the worst counts."""
    pattern, _ = CASES[case]
    mosaic, log = shot(pattern, (500, 40)), SolverLog()
    found, bands = render(mosaic, PAPER).solvers, list(render_bands(mosaic, PAPER, log))
    assert len(bands) > 1
    assert found == log.solvers
    assert list(found) == ["luminance", "medians", "affinity"]
    assert found["luminance"].iterations == PAPER.luminance.iterations
    assert 0 < found["luminance"].residual < FILLED
    assert (found["medians"].residual == 0) == (found["medians"].iterations < PAPER.chromaticity.repetitions)
    assert 0 < found["affinity"].residual <= PAPER.affinity.tolerance
    tight = render(mosaic, TIGHT).solvers["affinity"]
    assert found["affinity"].iterations < tight.iterations <= PAPER.affinity.iterations
    assert tight.residual <= TIGHT.affinity.tolerance
    few = render(
        mosaic, replace(PAPER, luminance=LuminanceSettings(iterations=3), chromaticity=ChromaticitySettings(repetitions=1))
    )
    assert few.solvers["luminance"].residual > 10 * found["luminance"].residual
    assert few.solvers["medians"].iterations == 1
    assert 0 < few.solvers["medians"].residual <= 1


# ---- no dead knobs, no dead stages

Change = tuple[Any, float | None]
PRESETS = {"paper": PAPER, "best": BEST}
# Every field of every part of the settings -> another value, and the noise of the shot: what its calibration admits (None: that it
# has none and knows nothing of it), or with BLIND, what it does not know.
BLIND = -0.05
MOVED: dict[str, dict[str, Change]] = {
    "noise": {"estimate": (False, BLIND)},
    "defects": {"listed": (False, None), "contrast": (0.0, None), "deviations": (1e3, 0.02), "floor": (5.0, None)},
    "highlights": {"restored": (False, None), "shoulder": (0.9, None)},
    "luminance": {"iterations": (10, 0.02), "decay": (0.95, 0.02), "threshold": (0.05, 0.02)},
    "denoising": {
        "strength": (0.5, 0.02),
        "sizes": ((12,), 0.02),
        "threshold": (2.0, 0.02),
        "share": (0.6, 0.02),
        "similarity": (1.0, 0.02),
        "radius": (1, 0.2),
    },
    "chromaticity": {"taps": (3, 0.02), "repetitions": (1, 0.02), "trust": (1e3, None), "mismatch": (0.05, None)},
    "pooling": {"passes": ((PoolingPass(1.0, 0.5, 5),), 0.02), "light": (1.0, 0.02), "doubt": (0.0, 0.02)},
    "affinity": {"scales": ((1.0, 2.0), 0.02), "tolerance": (0.1, 0.02), "iterations": (2, 0.02)},
    "propagation": {"softness": (3.0, 0.02)},
    "refinement": {"strength": (5.0, 0.02), "floor": (0.1, None), "blur": (0.5, 0.02), "repetitions": (1, 0.02)},
    "sites": {"corrected": (False, None), "deviations": (20.0, 0.02), "agreement": (0.05, None)},
    "learned": {"used": (False, None)},
}
# What is switched off in a preset, but for the setting that switches it on.
# Parts that only a damaged shot has need of.
BEYOND = ("defects", "highlights")
OFF = {"paper": {*BEYOND, "noise", "denoising", "pooling", "sites", "learned"}, "best": {"refinement"}}


def busy_shot(sigma: float | None) -> Mosaic:
    """Enough blocks, and enough errors among them, that every stage has something to do; a negative sigma is kept secret."""
    pattern = CfaPattern.bayer(4, origin=(1, 2))
    if sigma is None or sigma >= 0:
        return shot(pattern, (45, 50), sigma)
    secret = shot(pattern, (120, 130), -sigma)  # so large that it can be told from the frame
    return Mosaic(secret.signal, pattern, replace(secret.calibration, noise=None))


def damaged_shot(sigma: float | None) -> Mosaic:
    """Sensor codes of a ramp that the panchromatic pixels cannot follow, hot pixels at its foot, and a listed row of dead ones."""
    pattern, shape = CfaPattern.bayer(4, origin=(1, 2)), (45, 50)
    scene = np.linspace(0.2, 1.6, shape[1])[:, None] * np.broadcast_to([1.0, 0.9, 0.7], (*shape, 3))
    noise = np.random.default_rng(1).normal(scale=sigma or 0, size=shape)
    mosaic = observe(scene, pattern, gamma_of(pattern), sigma, noise)
    signal = np.minimum(mosaic.signal, mosaic.calibration.full_scale)
    signal[21:26, 38] *= 0.05  # a stroke among clipped samples, which ends in a block
    signal[20, 8] = signal[31, 12] = signal[33, 7] = mosaic.calibration.full_scale
    signal[8, 9:12] = 0
    calibration = replace(mosaic.calibration, defects=((8, 9), (8, 10), (8, 11)))
    return Mosaic(Mosaic(signal, pattern, calibration).codes, pattern, calibration)


def test_every_setting_is_moved() -> None:
    assert {part.name: {knob.name for knob in fields(getattr(PAPER, part.name))} for part in fields(PAPER)} == {
        part: set(knobs) for part, knobs in MOVED.items()
    }


@pytest.mark.parametrize(
    ("preset", "part", "knob"),
    [(name, part, knob) for name, off in OFF.items() for part, knobs in MOVED.items() if part not in off for knob in knobs],
)
def test_every_setting_matters(preset: str, part: str, knob: str) -> None:
    value, sigma = MOVED[part][knob]
    settings = PRESETS[preset]
    mosaic = damaged_shot(sigma) if part in BEYOND else busy_shot(sigma)
    moved = replace(settings, **{part: replace(getattr(settings, part), **{knob: value})})
    assert moved != settings
    if (part, knob) == ("affinity", "iterations"):  # it bounds the work, never the result
        with pytest.raises(ConvergenceError):
            render(mosaic, moved)
        return
    assert np.abs(render(mosaic, moved).rgb - render(mosaic, settings).rgb).max() > SEEN


@pytest.mark.parametrize("sigma", [None, 0.0])
def test_without_noise_denoising_and_pooling_do_nothing(sigma: float | None) -> None:
    mosaic, plain = busy_shot(sigma), replace(BEST, noise=PAPER.noise)
    off = replace(plain, denoising=PAPER.denoising, pooling=PAPER.pooling)
    assert np.array_equal(render(mosaic, plain).rgb, render(mosaic, off).rgb)


def even_affinities(luminance: FloatArray, pattern: CfaPattern, _: Any, band: Band, *__: Any) -> FloatArray:
    (first, end), across = band.patches, pattern.grid((luminance.shape[0], luminance.shape[1])).patches[1]
    return np.full((2, 2, (end - first) * pattern.period, across * pattern.period), 0.25, np.float32)


def grey_blocks(mosaic: Mosaic, *_: Any) -> FloatArray:
    shape = *mosaic.pattern.grid(mosaic.shape).shape, len(mosaic.pattern.channels)
    return np.full(shape, mosaic.calibration.grey, np.float32)


def mean_block(blocks: FloatArray, _: FloatArray, luminance: FloatArray, *__: Any) -> FloatArray:
    mean: FloatArray = blocks.mean(axis=(0, 1))
    return np.broadcast_to(mean, (*luminance.shape, mean.size)).copy()


def untrusted(*given: Any) -> SiteSamples:
    measured = site_samples(*given)
    return replace(measured, trusted=np.zeros_like(measured.trusted))


NEUTRAL: dict[str, Callable[..., Any]] = {
    "noise_of": lambda *_: None,
    "clipping_level": lambda _: np.inf,
    "mend_defects": lambda mosaic, *_: mosaic,
    "restore_highlights": lambda mosaic, *_: mosaic,
    "recover_luminance": lambda mosaic, *_: mosaic.signal.copy(),  # kernels are compiled anew for arrays that are read-only
    "denoise_luminance": lambda filled, *_: filled,
    "estimate_chromaticities": grey_blocks,
    "pool_blocks": lambda measured, *_: measured,
    "trust_in_blocks": lambda *_: None,
    "with_trusted_colour": lambda blocks, *_: blocks,
    "solve_affinities": even_affinities,
    "propagate": mean_block,
    "noise_level": lambda *_: 0.0,
    "refine": lambda initial, *_: initial,
    "site_samples": untrusted,
    "unclipped_blocks": lambda mosaic, _: unclipped_blocks(mosaic, np.inf),
    "settle_luminance": lambda luminance, *_: luminance,
    "correct_sites": lambda part, *_: part,
    "learner_for": lambda *_: None,
}


def test_every_stage_of_the_page_has_a_neutral_one() -> None:
    named = {name for page in (PAGE.measure, PAGE.spread, PAGE.finish) for name in page.__code__.co_names}
    cut = {"bands", "reach", "windows", "spread"}  # where bands are cut leaves no trace
    assert {name for name in named if isfunction(getattr(PAGE, name, None))} == {*NEUTRAL, *cut}


# In BEST the oriented medians and all before them only tell what looks alike, and refinement rests.
DAMAGED = {"clipping_level", "mend_defects", "restore_highlights", "unclipped_blocks"}
LATE = {"site_samples", "settle_luminance", "correct_sites", "learner_for", "trust_in_blocks", "with_trusted_colour"}
IDLE = {"paper": {*DAMAGED, *LATE, "noise_of", "denoise_luminance", "pool_blocks"}, "best": {"noise_level", "refine"}}


@pytest.mark.parametrize(
    ("preset", "stage"), [(name, stage) for name, idle in IDLE.items() for stage in NEUTRAL if stage not in idle]
)
def test_every_stage_matters(preset: str, stage: str, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = PRESETS[preset]
    mosaic = damaged_shot(0.02) if stage in DAMAGED else busy_shot(0.02)
    whole = render(mosaic, settings).rgb
    monkeypatch.setattr(PAGE, stage, NEUTRAL[stage])
    idle = render(mosaic, settings).rgb
    assert np.abs(idle - whole).max() > SEEN
    assert np.abs(idle - whole).mean() > SEEN
