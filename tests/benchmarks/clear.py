"""Compare ways to develop mosaics of cars: python -m tests.benchmarks.clear [SCENE...] [--side N]

A sensor with the tile RCCB or RCCG photographs each scene (by default the test photographs),
at sigma 0 and 0.01, and with a quarter of its full exposure. The same shot is developed by

    best, preview   with the channel that has no filter as what panchromatic pixels see beyond the
                    others (Eq. 7)
    as Bayer        with W in the place of green, by DLMMSE of balanced samples; a matrix then takes
                    its channels to the scene's. The matrix is fitted to the very scene, by least
                    squares, which is more than its users know

and compared with what the sensor's channels would see: median, 10 % quantile and whole image
(dB), and the share of pixels of wrong hue, means over the scenes.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from panchroma.device import Preview
from panchroma.offline import render
from panchroma.shared import CfaPattern, FloatArray, Mosaic
from panchroma.tools.evaluation.metrics import BORDER, wrong_hue
from panchroma.tools.evaluation.rivals.dlmmse import demosaic_dlmmse
from panchroma.tools.simulation.load import load_scene
from panchroma.tools.simulation.protocols import PaperProtocol, Protocol, SensorProtocol
from panchroma.tools.simulation.simulated_camera import SimulatedCamera
from tests.benchmarks.harness import SEED, middle, options, photographs, psnrs

NOISES: dict[str, Protocol] = {
    "sigma 0": PaperProtocol(0.0),
    "sigma 0.01": PaperProtocol(0.01),
    "light 0.25": SensorProtocol(0.25),
}
TILES = "rccb", "rccg"


def as_bayer(mosaic: Mosaic, truth: FloatArray) -> FloatArray:
    """A picture from a mosaic whose tile looks like RGGB with W in the place of green."""
    channels = len(mosaic.pattern.channels)
    white = np.ones(channels) if mosaic.calibration.neutral is None else mosaic.calibration.neutral
    white = np.append(white, np.dot(mosaic.calibration.gamma, white))
    shares = white.astype(np.float32)[mosaic.pattern.filter_map(mosaic.shape)]
    picture = demosaic_dlmmse(mosaic.signal / shares).reshape(-1, 3)
    matrix, *_ = np.linalg.lstsq(picture, truth.reshape(-1, channels))
    return (picture @ matrix).reshape(truth.shape).astype(np.float32)


def figures(picture: FloatArray, truth: FloatArray) -> list[float]:
    """Median, 10 % quantile, whole image (dB), and wrong hues (%)."""
    inner = slice(BORDER, -BORDER)
    wrong = wrong_hue(picture[inner, inner], truth[inner, inner]).mean()
    return [*psnrs(picture, truth), 100 * float(wrong)]


def main() -> None:
    """Print a row for each tile, noise and way."""
    chosen = options(__doc__, "*", side=360)
    print("tile  noise       way       median  10 %   whole  wrong hue %")
    for name in TILES:
        pattern = CfaPattern.of_letters(name)
        preview = Preview(pattern, linear=True)
        for noise, protocol in NOISES.items():
            camera = SimulatedCamera(pattern, None, protocol)
            rows: dict[str, list[list[float]]] = {"best": [], "preview": [], "as Bayer": []}
            for path in map(Path, chosen.scenes or photographs()):
                scene = load_scene(str(path))
                part = replace(scene, rgb=middle(scene.rgb, chosen.side))
                exposed = camera.shoot(part, np.random.default_rng(SEED))
                mosaic, truth, white = exposed.mosaic, exposed.truth, np.float32(exposed.white)
                pictures = {
                    "best": render(mosaic).rgb,
                    "preview": preview.run(mosaic),
                    "as Bayer": as_bayer(mosaic, truth),
                }
                for way, picture in pictures.items():
                    seen = np.asarray(picture, np.float32) / white
                    rows[way].append(figures(seen, truth / white))
                print(f"{name} {noise} {path.name}", file=sys.stderr)
            for way, scenes in rows.items():
                means = "  ".join(f"{mean:5.2f}" for mean in np.mean(scenes, axis=0))
                print(f"{name}  {noise:<11} {way:<9} {means}")


if __name__ == "__main__":
    main()
