"""How far frames agree: in spite of noise, a little more exposure and sampling; each kind of change is
found by a sign of its own.
"""

from collections.abc import Callable

import numpy as np
import pytest

from panchroma.offline.burst import Motion
from panchroma.offline.burst import agree as module
from panchroma.offline.burst.agree import agreement_of_luminance, lit_evenly, shaded_alike
from panchroma.offline.burst.align import View
from panchroma.offline.frame import Sites
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import DoubleArray
from tests.scenes import darker_corners

SHAPE = (90, 120)
INSIDE = np.s_[35:55, 45:75]
Y, X = np.indices(SHAPE).astype(np.float64)
THING = np.zeros(SHAPE)
THING[25:65, 35:85] = 1


def luminance_at(y: DoubleArray = Y, x: DoubleArray = X, contrast: float = 0.2) -> DoubleArray:
    return 1 + contrast * np.sin(y / 2.5) * np.cos(x / 3)


def agrees(reference: DoubleArray, frame: DoubleArray, sigma: float) -> float:
    """The mean agreement where the thing is, 0 to 1."""
    random, noise = np.random.default_rng(0), NoiseModel.gaussian(sigma, 4)
    first, second = (
        View((plane + random.normal(0, sigma, SHAPE)).astype(np.float32), noise)
        for plane in (reference, frame)
    )
    agreement = agreement_of_luminance(first, second, np.ones(SHAPE, np.float32))
    return float(agreement[INSIDE].mean()) / 255


EVEN = Mosaic(np.ones((210, 300), np.float32), CfaPattern.bayer(6), SensorCalibration())
SHADED = EVEN.calibrated(SensorCalibration(shading=darker_corners(EVEN.shape)))


@pytest.mark.parametrize(
    "correct",
    [
        lambda view: view.darker(0.3),
        lambda view: lit_evenly(view, SHADED),
        lambda view: shaded_alike(view, SHADED, EVEN, Motion((2, -3))),
        lambda view: shaded_alike(view, EVEN, SHADED, Motion((2, -3))),
    ],
    ids=["exposure", "shading", "shaded frame", "shaded reference"],
)
def test_what_scales_samples_scales_their_noise_and_their_limit(
    correct: Callable[[View], View],
) -> None:
    noise, sites = NoiseModel((1e-3,) * 4, (0.02,) * 4), Sites.in_frame(EVEN)
    gains = np.array([0.5, 1, 1, 2], np.float32)  # that made the shading of colours even
    error = np.random.default_rng(0).normal(0, noise.sigma(1), EVEN.shape).astype(np.float32)
    noisy, clean, full = (
        correct(View(plane, noise, 3.0, gains * sites.of(plane), gains))
        for plane in (EVEN.signal + error, EVEN.signal, 3 * EVEN.signal)
    )
    for seen, true, gain in (
        (noisy.luminance, clean.luminance, 1.0),
        (noisy.colours, clean.colours, noisy.colour_gains),
    ):
        if seen.size:
            stated = noisy.noise.variance(true, -1, gain).mean(axis=(0, 1))
            assert np.square(seen - true).mean(axis=(0, 1)) == pytest.approx(stated, rel=0.25)
    assert not np.allclose(clean.luminance.mean(), 1, rtol=0.3)
    assert 0.7 * full.luminance.min() < noisy.limit < 1.001 * full.luminance.min()


@pytest.mark.parametrize("sigma", [0.0, 0.02, 0.1])
@pytest.mark.parametrize(
    "frame",
    [luminance_at(), 1.005 * luminance_at(), luminance_at(Y, X + 0.1)],
    ids=["same", "exposure", "sampling"],
)
def test_what_has_not_changed_agrees(frame: DoubleArray, sigma: float) -> None:
    assert agrees(luminance_at(), frame, sigma) > 0.9


CHANGES = {
    "_MEAN": (luminance_at(), luminance_at() + 0.12 * THING, 0.02),
    "_TEXTURE": (
        luminance_at(contrast=0.05),
        luminance_at(contrast=0.05) + 0.06 * THING * (-1) ** (Y + X),
        0.01,
    ),
    "_FAR": (luminance_at(contrast=0.05), luminance_at(contrast=0.05) + 0.02 * THING, 0.05),
    "_SHIFT": (luminance_at(), luminance_at(Y, X + 0.6), 0.02),
}


@pytest.mark.parametrize("sign", list(CHANGES))
def test_what_has_changed_does_not(sign: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert agrees(*CHANGES[sign]) < 0.35
    for other in CHANGES.keys() - {sign}:
        monkeypatch.setattr(module, other, 1e6)
    assert agrees(*CHANGES[sign]) < 0.4, "this sign alone does not find it"
    monkeypatch.setattr(module, sign, 1e6)
    assert agrees(*CHANGES[sign]) > 0.85


def test_strips_leave_no_trace() -> None:
    planes = np.random.default_rng(1).uniform(0.5, 1.5, (3, 600, 40)).astype(np.float32)
    whole, lower = (
        agreement_of_luminance(View(first), View(second), weight)
        for first, second, weight in (planes, planes[:, 256:])
    )
    assert np.array_equal(lower[40:], whole[296:])
