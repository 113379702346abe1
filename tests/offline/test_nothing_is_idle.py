"""No dead knobs, no dead stages: each setting and each stage of the page is moved, and the picture
changes.
"""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from panchroma.offline import BEST, PAPER, PRESETS, render
from panchroma.offline.stage import Switch
from panchroma.offline.stages.pooling import PoolingPass
from panchroma.shared import CfaPattern, Mosaic
from panchroma.shared.errors import ConvergenceError
from tests.offline.scenes import gamma_of, shot
from tests.reference.sensor import observe

# Rounding does not move a picture as far as this; every setting and stage does.
SEEN = 1e-4

Change = tuple[Any, float | None]
SWITCHES = [stage.name for stage in fields(PAPER) if isinstance(getattr(PAPER, stage.name), Switch)]
# Every field of every stage of the settings -> another value, and the noise of the shot: what its
# calibration admits (None: that it has none and knows nothing of it), or with BLIND, what it does
# not know.
# the second in noise, and with channels that no network knows
BLIND, FOREIGN = -0.05, 0.03
MOVED: dict[str, dict[str, Change]] = {
    "noise": {"estimate": (False, BLIND)},
    "defects": {
        "listed": (False, None),
        "contrast": (0.0, None),
        "deviations": (1e3, 0.02),
        "floor": (5.0, None),
    },
    "highlights": {"restored": (False, None), "shoulder": (0.9, None)},
    "luminance": {
        "iterations": (10, 0.02),
        "decay": (0.95, 0.02),
        "threshold": (0.05, 0.02),
        "relative": (None, 0.02),
        "learned": (None, 0.02),
    },
    "denoising": {"strength": (0.5, 0.02), "sizes": ((12,), 0.02), "threshold": (2.0, 0.02)},
    "chromaticity": {"repetitions": (1, FOREIGN), "learned": (None, 0.02)},
    "pooling": {
        "passes": ((PoolingPass(1.0, 0.5, 5),), 0.02),
        "light": (1.0, 0.02),
        "curvature_error": (0.0, FOREIGN),
    },
    "affinity": {"scales": ((1.0, 2.0), 0.02), "tolerance": (0.1, 0.02), "iterations": (2, 0.02)},
    "propagation": {"softness": (3.0, 0.02), "likeness": (200.0, 0.02)},
    "refinement": {
        "strength": (5.0, 0.02),
        "floor": (0.1, None),
        "blur": (0.5, 0.02),
        "repetitions": (1, 0.02),
    },
    **{name: {"used": (False, None)} for name in SWITCHES},
}
# Stages that a damaged shot has need of.
BEYOND = ("defects", "highlights")
OFF = {"paper": {*BEYOND, "noise", "denoising", "pooling", *SWITCHES}, "best": {"refinement"}}


def busy_shot(sigma: float | None) -> Mosaic:
    """Enough blocks, and enough errors among them, that every stage has something to do; a negative
    sigma is kept secret.
    """
    pattern = CfaPattern.bayer(4, origin=(1, 2))
    if sigma == FOREIGN:
        pattern = CfaPattern.of_letters("RXWW/GBWW/WWWW/WWWW")
    if sigma is None or sigma >= 0:
        return shot(pattern, (45, 50), sigma)
    secret = shot(pattern, (120, 130), -sigma)  # so large that it can be told from the frame
    return Mosaic(secret.signal, pattern, replace(secret.calibration, noise=None))


def damaged_shot(sigma: float | None) -> Mosaic:
    """Sensor codes of a ramp that the panchromatic pixels cannot follow, hot pixels at its foot,
    and a listed row of dead ones.
    """
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


SHOTS = dict.fromkeys(BEYOND, damaged_shot)


def test_every_setting_is_moved() -> None:
    assert {
        stage.name: {knob.name for knob in fields(getattr(PAPER, stage.name))}
        for stage in fields(PAPER)
    } == {stage: set(knobs) for stage, knobs in MOVED.items()}


@pytest.mark.parametrize(
    ("preset", "stage", "knob"),
    [
        (name, stage, knob)
        for name, off in OFF.items()
        for stage, knobs in MOVED.items()
        if stage not in off
        for knob in knobs
    ],
)
def test_every_setting_matters(preset: str, stage: str, knob: str) -> None:
    value, sigma = MOVED[stage][knob]
    settings = PRESETS[preset]
    value = not getattr(settings.luminance, knob) if knob in {"relative", "learned"} else value
    mosaic = SHOTS.get(stage, busy_shot)(sigma)
    moved = replace(settings, **{stage: replace(getattr(settings, stage), **{knob: value})})
    assert moved != settings
    if (stage, knob) == ("affinity", "iterations"):  # it bounds the work, never the result
        with pytest.raises(ConvergenceError):
            render(mosaic, moved)
        return
    assert np.abs(render(mosaic, moved).rgb - render(mosaic, settings).rgb).max() > SEEN


@pytest.mark.parametrize("sigma", [None, 0.0])
def test_without_noise_denoising_and_pooling_do_nothing(sigma: float | None) -> None:
    mosaic, plain = busy_shot(sigma), replace(BEST, noise=PAPER.noise)
    off = replace(plain, denoising=PAPER.denoising, pooling=PAPER.pooling)
    assert np.array_equal(render(mosaic, plain).rgb, render(mosaic, off).rgb)
