"""Measure denoised luminance: python -m tests.benchmarks.low_light SCENE... [--sigma 0.01 0.03]

For each scene and noise the median PSNR of the luminance of all 10 x 10 patches (dB): of `best`, and of BM3D on the panchromatic
plane whose holes the paper's method has filled. Needs the package `bm3d`. Colour is measured by `panchroma evaluate`.
"""

import argparse

import bm3d
import numpy as np

from offline import BEST, PAPER, render
from offline.whole.luminance import recover_luminance
from shared.arrays import FloatArray
from tools.camera.protocols import PaperProtocol
from tools.evaluation.cameras import CameraPair
from tools.evaluation.metrics import quality
from tools.evaluation.scene_sets import Reading
from tools.evaluation.tiles import Tile


def measured(luminance: FloatArray, rgb: FloatArray) -> float:
    """The median of a panchromatic plane, as the luminance of the grey picture that sums to it."""
    grey, truth = (np.repeat(plane[..., None] / np.float32(3), 3, axis=2) for plane in (luminance, rgb.sum(axis=2)))
    return quality(grey, truth).luminance[2]


def main() -> None:
    """Print a line for each scene and noise."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="SCENE")
    parser.add_argument("--sigma", nargs="+", type=float, default=[0.01, 0.03])
    arguments = parser.parse_args()
    for source in arguments.scenes:
        rgb = Reading().scene(source).rgb
        for sigma in arguments.sigma:
            shot = CameraPair(PaperProtocol(sigma), 0, rgb, Tile.of_period(6).pattern, None).sparse
            filled = recover_luminance(shot, PAPER.luminance).astype(np.float64)
            ours = measured(render(shot, BEST).rgb.sum(axis=2), rgb)
            theirs = measured(np.asarray(bm3d.bm3d(filled, sigma), np.float32), rgb)
            print(f"{source}, sigma {sigma:g}: best {ours:.2f}, BM3D {theirs:.2f}, {ours - theirs:+.2f} dB", flush=True)


if __name__ == "__main__":
    main()
