"""How much colour black print gets: python -m tests.benchmarks.black_print [--pattern 6 4 kodak] [--font DejaVuSans.ttf]

Lines of 9 to 40 pixels, 0.06 on 0.8. Tint is the largest distance of a channel from their mean, scene units: its 99.9 %
quantile and maximum, over all pixels.
"""

import argparse

import numpy as np

from device import Preview
from offline import PRESETS, render
from shared import CfaPattern, Mosaic, SensorCalibration
from shared.arrays import FloatArray
from shared.sensor import simulate_additive

INK, PAPER, SHAPE, FINE = 0.06, 0.8, (360, 440), 4
SIZES = (9, 9, 10, 10, 11, 11, 12, 12, 14, 14, 16, 18, 20, 24, 28, 32, 40)  # pixels
WORDS = "The quick brown fox jumps over the lazy dog, 0123456789 &%?!"


def page(font: str) -> FloatArray:
    """The page, float32 (H, W, 3)."""
    from PIL import Image, ImageDraw, ImageFont

    plane, top = Image.new("F", (SHAPE[1] * FINE, SHAPE[0] * FINE), PAPER), 4.0
    pen = ImageDraw.Draw(plane)
    for line, size in enumerate(SIZES):
        pen.text((5 * FINE, top * FINE), WORDS[7 * (line % 5) :], INK, ImageFont.truetype(font, size * FINE))
        top += 1.25 * size + 2
    grey = np.asarray(plane).reshape(SHAPE[0], FINE, SHAPE[1], FINE).mean(axis=(1, 3)).astype(np.float32)
    return grey[..., None].repeat(3, axis=2)


def main() -> None:
    """Print a line for each pattern, noise and method."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pattern", nargs="+", default=["6"], metavar="K|NAME")
    parser.add_argument("--font", default="DejaVuSans.ttf")
    given = parser.parse_args()
    scene, calibration = page(given.font), SensorCalibration.of_bits(12, headroom=False)
    for name in given.pattern:
        pattern = CfaPattern.bayer(int(name)) if name.isdigit() else CfaPattern.of_letters(name)
        for sigma in (0.0, 0.01, 0.03):
            shot = simulate_additive(scene, pattern, calibration, sigma, np.random.default_rng(0))
            coded = Mosaic(shot.codes, pattern, shot.calibration)
            pictures = {preset: render(shot, settings).rgb for preset, settings in PRESETS.items()}
            pictures["preview"] = np.asarray(Preview(pattern, linear=True).run(coded), np.float32)
            for method, rgb in pictures.items():
                tint = np.abs(rgb - rgb.mean(axis=2, keepdims=True)).max(axis=2)
                print(f"{name:6} {sigma:<5} {method:10} {np.quantile(tint, 0.999):.3f} {tint.max():.3f}", flush=True)


if __name__ == "__main__":
    main()
