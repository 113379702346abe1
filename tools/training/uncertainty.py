"""Learn the weights of `offline.rows.uncertainty`: `python -m tools.training.uncertainty FOLDER... --camera FOLDER`.

Photographs are simulated and rendered, and each of what foretells errors gets the weight that makes the errors most probable:
variances are sums with weights that are not negative, and errors have the tails of Student's t with four degrees of freedom. Then
variances are scaled so that 68 % of the errors lie within one and 95 % within two standard deviations, as nearly as can be, for the
kind of picture that needs most (with noise or without, with a camera's own grain or made up): rather too careful than too sure.
"""

import argparse
import sys
from functools import reduce
from pathlib import Path
from typing import NamedTuple

import numpy as np

from offline.parts import Part
from offline.render import measure, parts_of
from offline.rows.uncertainty import WEIGHTS, Uncertainty
from offline.settings import BEST
from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import DoubleArray, FloatArray
from shared.sensor import simulate_additive
from tools.host.console import Console

from ..scenes.load import load_scene
from .examples import varied

_SIDE, _BORDER, _PIXELS = 300, 15, 2000  # pixels: of a picture, left out, and taken of each
_FREEDOM = 4.0  # of Student's t
_WITHIN = 0.6827, 0.9545  # of a normal distribution: within one and two standard deviations
_GRAIN = (5e-7, 6e-5)  # range of the shot noise that photographs without grain get, drawn logarithmically
_SIGMAS = (0.003, 0.04)  # of the noise, likewise; a third of the pictures have none
_LEAST = 1e-12  # of a variance


class Errors(NamedTuple):
    """Errors of a picture, (N,), and what foretells them, (N, 6): squares of what has their unit."""

    errors: DoubleArray
    foretold: DoubleArray


def errors_of(mosaic: Mosaic, scene: FloatArray, random: np.random.Generator) -> tuple[Errors, Errors]:
    """The errors of luminance and of colour of some pixels of a rendered shot; gamma is 1. scene: the truth, (H, W, C)."""
    measured = measure(mosaic, BEST)
    part = reduce(Part.joined, parts_of(measured, BEST))
    inner = (slice(_BORDER, -_BORDER),) * 2
    light, true = part.luminance, scene.sum(axis=2)
    grey = scene.shape[2]
    colour = (part.chromaticity - np.float32(1 / grey)) * light[..., None] - (scene - true[..., None] / grey)
    wrong = np.concatenate([(light - true)[..., None], colour], axis=2)[inner].reshape(-1, 1 + grey)
    chosen = random.permutation(len(wrong))[:_PIXELS]
    planes, found = [], Uncertainty.of(mosaic, measured, BEST)
    for weights in np.eye(len(WEIGHTS[0])):
        found.weights = (tuple(weights), tuple(weights))
        stated = found(part, (0, len(light))).uncertainty
        assert stated is not None
        planes.append(np.square(stated[inner].reshape(-1, 1 + grey)[chosen]))
    foretold, errors = np.stack(planes, axis=2).astype(np.float64), wrong[chosen].astype(np.float64)
    known = foretold[:, 0].any(axis=1)  # the others are measured without noise
    return Errors(errors[known, 0], foretold[known, 0]), Errors(errors[:, 1:].ravel(), foretold[:, 1:].reshape(-1, len(planes)))


def fitted(errors: DoubleArray, foretold: DoubleArray) -> DoubleArray:
    """The weights, (6,), that make errors most probable."""
    from scipy.optimize import minimize

    unit = np.sqrt(np.square(foretold).mean(axis=0)) + _LEAST
    scaled, squares = foretold / unit, np.square(errors)

    def loss(logarithms: DoubleArray) -> tuple[float, DoubleArray]:
        weights = np.exp(logarithms)
        variance = scaled @ weights + _LEAST
        ratio = squares / (variance * _FREEDOM)
        slope = (0.5 - 0.5 * (_FREEDOM + 1) * ratio / (1 + ratio)) / variance
        value = 0.5 * np.log(variance) + 0.5 * (_FREEDOM + 1) * np.log1p(ratio)
        return float(value.mean()), (scaled.T @ slope) / len(errors) * weights

    start = np.full(foretold.shape[1], np.log(squares.mean() / foretold.shape[1] + _LEAST))
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=[(-35, 5)] * len(start))
    weights: DoubleArray = np.exp(found.x) / unit
    return weights


def scale(errors: DoubleArray) -> float:
    """What standard deviations are multiplied by, so that coverage is right. errors: in units of them."""
    candidates, sizes = np.linspace(0.7, 2.0, 261), np.sort(np.abs(errors))
    off = [np.abs(np.searchsorted(sizes, times * candidates) / len(sizes) - within) for times, within in enumerate(_WITHIN, 1)]
    return float(candidates[np.max(off, axis=0).argmin()])


def learn(groups: list[list[Errors]]) -> DoubleArray:
    """The weights, (6,), from errors by kind of picture; each kind counts the same."""
    largest = max(sum(len(each.errors) for each in group) for group in groups)
    repeated = [each for group in groups for each in group * max(1, round(largest / sum(len(one.errors) for one in group)))]
    weights = fitted(*map(np.concatenate, zip(*repeated, strict=True)))
    apart = [np.concatenate([each.errors / np.sqrt(each.foretold @ weights + _LEAST) for each in group]) for group in groups]
    return weights * max(map(scale, apart)) ** 2


def main() -> int:
    """Learn, and print the weights; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.training.uncertainty", description=__doc__.partition("\n\n")[0])
    parser.add_argument("folders", nargs="+", metavar="FOLDER", help="photographs in this folder; they get grain")
    parser.add_argument("--camera", required=True, metavar="FOLDER", help="linear pictures of a camera, which have grain")
    parser.add_argument("--photographs", type=int, default=90, metavar="N", help="number of them to take (default: 90)")
    parser.add_argument("--variants", type=int, default=6, metavar="N", help="of each linear picture (default: 6)")
    parser.add_argument("--period", type=int, default=6, metavar="K", help="period of the pattern (default: 6)")
    arguments, console = parser.parse_args(), Console()
    files = sorted(path for folder in arguments.folders for path in Path(folder).glob("*.*") if path.suffix != ".md")
    order = np.random.default_rng(0).permutation(len(files))[: arguments.photographs]
    camera = sorted(Path(arguments.camera).glob("*.*")) * arguments.variants
    found: tuple[list[list[Errors]], ...] = ([[] for _ in range(4)], [[] for _ in range(4)])
    with console.progress("uncertainty") as progress:
        progress.stage("pictures", len(order) + len(camera))
        for number, path in enumerate([*(files[place] for place in order), *camera]):
            random, own = np.random.default_rng((0, number)), number >= len(order)
            scene = _scene(path, random, grainy=own)
            sigma = 0.0 if number % 3 == 0 else float(np.exp(random.uniform(*np.log(_SIGMAS))))
            shot = simulate_additive(scene, CfaPattern.bayer(arguments.period), SensorCalibration(), sigma, random)
            for kinds, errors in zip(found, errors_of(shot, scene, random), strict=True):
                kinds[2 * own + (sigma > 0)].append(errors)
            progress.advance()
    rows = (", ".join(f"{weight:.2g}" for weight in learn(groups)) for groups in found)
    console.say(f"WEIGHTS = ({', '.join(f'({row})' for row in rows)})")
    return 0


def _scene(path: Path, random: np.random.Generator, *, grainy: bool) -> FloatArray:
    """A picture, (H, W, 3), in other light; photographs without grain get some, as a camera's quads of pixels have it."""
    scene = load_scene(str(path)).rgb
    if grainy:
        gains = np.exp(random.normal(0, 0.2, 3))
        bright = min(1.0, 1 / max(float(np.quantile(scene, 0.999)), 1e-3)) * 2 ** random.uniform(-1.5, 0)
        scene = scene * (gains / gains.max() * bright)
    else:
        scene = varied(scene, random)
        shot = float(np.exp(random.uniform(*np.log(_GRAIN))))
        deviation = np.sqrt((scene + 0.03) * shot * np.array([1, 0.5, 1]))  # a quad has two greens
        scene = (scene + random.normal(size=scene.shape) * deviation).clip(0)
    return np.ascontiguousarray(scene[:_SIDE, :_SIDE], np.float32)


if __name__ == "__main__":
    sys.exit(main())
