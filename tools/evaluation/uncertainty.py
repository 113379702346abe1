"""Learn the weights of `offline.rows.uncertainty`: `python -m tools.evaluation.uncertainty PHOTOGRAPH...`.

Whole photographs are simulated, without noise and with some, and rendered. Weights are those with which 68 % of the errors lie
within one and 95 % within two stated deviations: both are quantiles of the error divided by what is stated, and the fit minimises
the loss of quantile regression (Koenker and Bassett 1978) in its logarithm. Each noise counts the same; and in it flat places, most
of what there is, twice as much as edges and fine colour: once for themselves, once for the picture.
"""

import argparse
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offline.parts import Part
from offline.render import measure, parts_of
from offline.rows.uncertainty import WEIGHTS, Uncertainty
from offline.settings import BEST
from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import DoubleArray, FloatArray, IndexArray
from shared.sensor import simulate_additive
from tools.host.console import Console
from tools.scenes.load import load_scene

from .coverage import KINDS, kinds
from .metrics import BORDER

_SHARE = 0.1  # of the pixels
_WITHIN = 0.6827, 0.9545  # of a normal distribution: within one and two standard deviations
_SIGMAS = (0.0, 0.01, 0.03)  # of the noise; between them coverage lies between (measured)
_COUNTS = 2.0, 1.0, 1.0  # of the kinds of place
_LEAST = 1e-12  # of a variance
_ROUNDED = 0.05  # of a logarithm: the corner of the loss


class Errors(NamedTuple):
    """Errors of a picture, (N,); what foretells them, (N, 6): squares of what has their unit; the kind of each, (N,), integers."""

    errors: DoubleArray
    foretold: DoubleArray
    kinds: IndexArray


def errors_of(mosaic: Mosaic, scene: FloatArray, share: float, random: np.random.Generator) -> tuple[Errors, Errors]:
    """The errors of luminance and of colour of a share of a rendered shot's pixels; gamma is 1. scene: the truth, (H, W, C)."""
    measured = measure(mosaic, BEST)
    part = Part.joined(list(parts_of(measured, BEST)))
    inner = (slice(BORDER, -BORDER),) * 2
    light, true = part.luminance, scene.sum(axis=2)
    grey = scene.shape[2]
    colour = (part.chromaticity - np.float32(1 / grey)) * light[..., None] - (scene - true[..., None] / grey)
    wrong = np.concatenate([(light - true)[..., None], colour], axis=2)[inner].reshape(-1, 1 + grey)
    chosen = np.flatnonzero(random.random(len(wrong)) < share)
    planes, found = [], Uncertainty.of(mosaic, measured, BEST)
    for weights in np.eye(len(WEIGHTS[0])):
        found.weights = (tuple(weights), tuple(weights))
        stated = found(part, (0, len(light))).uncertainty
        assert stated is not None
        planes.append(np.square(stated[inner].reshape(-1, 1 + grey)[chosen]))
    foretold, errors = np.stack(planes, axis=2).astype(np.float64), wrong[chosen].astype(np.float64)
    places = kinds(scene)[inner].ravel()[chosen].astype(np.intp)
    known = foretold[:, 0].any(axis=1)  # the others are measured without noise
    of_colour = Errors(errors[:, 1:].ravel(), foretold[:, 1:].reshape(-1, len(planes)), places.repeat(grey))
    return Errors(errors[known, 0], foretold[known, 0], places[known]), of_colour


def fitted(errors: Errors, counts: Sequence[float]) -> DoubleArray:
    """The weights, (6,), not negative, with which errors lie within what is stated as often as they should.

    counts: what all errors of a kind count together.
    """
    from scipy.optimize import minimize

    unit = np.sqrt(np.square(errors.foretold).mean(axis=0)) + _LEAST
    scaled, sizes = errors.foretold / unit, np.log(np.abs(errors.errors) + _LEAST**0.5)
    each = (np.array(counts) / np.bincount(errors.kinds, minlength=len(counts)).clip(1))[errors.kinds]
    each /= each.sum()

    def loss(logarithms: DoubleArray) -> tuple[float, DoubleArray]:
        weights = np.exp(logarithms)
        variance = scaled @ weights + _LEAST
        value, slope = 0.0, np.zeros(len(sizes))
        for times, within in enumerate(_WITHIN, 1):
            off = (sizes - np.log(times) - np.log(variance) / 2) / _ROUNDED
            value += float(each @ (within * off + np.logaddexp(0, -off)))
            slope += 1 / (1 + np.exp(off.clip(-50, 50))) - within
        return value, (scaled.T @ (slope * each / variance)) / (2 * _ROUNDED) * weights

    start = np.full(len(unit), np.log(np.square(errors.errors).mean() / len(unit) + _LEAST))
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=[(-35, 5)] * len(start))
    return np.exp(found.x) / unit


def main() -> int:
    """Learn, and print the weights; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.evaluation.uncertainty", description=__doc__.partition("\n\n")[0])
    parser.add_argument("photographs", nargs="+", metavar="PHOTOGRAPH", help="RAWs and linear pictures: they have a camera's grain")
    arguments, console = parser.parse_args(), Console()
    found: tuple[list[Errors], ...] = ([], [])
    with console.progress("uncertainty") as progress:
        progress.stage("photographs", len(arguments.photographs))
        for place, photograph in enumerate(arguments.photographs):
            scene = load_scene(photograph).rgb
            for level, sigma in enumerate(_SIGMAS):
                random = np.random.default_rng((place, level))
                shot = simulate_additive(scene, CfaPattern.bayer(), SensorCalibration(), sigma, random)
                for each, errors in zip(found, errors_of(shot, scene, _SHARE, random), strict=True):
                    each.append(errors._replace(kinds=errors.kinds + len(KINDS) * level))
            progress.advance()
    counts = _COUNTS * len(_SIGMAS)
    learned = [fitted(Errors(*map(np.concatenate, zip(*each, strict=True))), counts) for each in found]
    rows = (", ".join(f"{weight:.2g}" for weight in weights) for weights in learned)
    console.say(f"WEIGHTS = ({', '.join(f'({row})' for row in rows)})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
