"""A thing that moves through a burst: how good is the picture where it was, beside a single render? Usage: SCENE..."""

import sys

import numpy as np

from offline import render
from offline.burst import merge_burst, render_burst_bands
from shared import SensorCalibration
from tests.benchmarks.harness import PATTERN, middle
from tests.benchmarks.moving_disc import with_disc
from tools.evaluation.metrics import psnr
from tools.simulation.burst import SimulatedBurst, burst_frames
from tools.simulation.load import load_scene
from tools.simulation.sensor import simulate_additive

_SIGMAS = (0.0, 0.01, 0.03)
_SIDE, _BORDER = 640, 15  # pixels: of the part of the scene, at full size; at the frame's edges, left out


def main() -> None:
    print("scene, sigma: PSNR single, burst where the thing was in any frame; and elsewhere")
    for path in sys.argv[1:]:
        rgb = middle(load_scene(path).rgb, _SIDE)
        still = list(burst_frames(rgb, SimulatedBurst(8, 3, 0.3), np.random.default_rng(1), 2))
        frames, things = with_disc(still, np.random.default_rng(1))
        truth = frames[0].rgb
        row, column = np.indices(truth.shape[:2])
        changed = np.any([np.hypot(row - y, column - x) < radius + 2 for y, x, radius in things], axis=0)
        inside = np.zeros_like(changed)
        inside[_BORDER:-_BORDER, _BORDER:-_BORDER] = True
        for sigma in _SIGMAS:
            rng = np.random.default_rng(2)
            shots = [simulate_additive(each.rgb, PATTERN, SensorCalibration(), sigma, rng) for each in frames]
            single = render(shots[0]).rgb
            burst = np.concatenate(list(render_burst_bands(merge_burst(shots, reference=0))))
            places = [where & inside for where in (changed, ~changed)]
            figures = [psnr(each[where][None], truth[where][None]) for where in places for each in (single, burst)]
            print(path, sigma, *(f"{figure:.2f}" for figure in figures), flush=True)


if __name__ == "__main__":
    main()
