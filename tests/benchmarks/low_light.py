"""Measure low light: python -m tests.benchmarks.low_light SCENE... [--sigma 0 0.01 0.03] [--rivals DIR]

For each scene, noise and method: 10 % and 25 % quantile and median of the PSNR of all 10 x 10 patches, PSNR of the whole picture
(dB), and the share of pixels of a wrong hue (%). The methods are `paper`, `best`, and Bayer + BM3D on its planes + Menon 2007.
Their luminance alone, too: `best`, and BM3D on the panchromatic plane whose holes the paper's method has filled. The rivals need
the packages `bm3d` and `colour-demosaicing`; they are slow, so that --rivals DIR keeps their figures.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from offline import BEST, PAPER, render
from offline.whole.luminance import recover_luminance
from shared.arrays import FloatArray
from shared.errors import InputError
from tools.camera.protocols import PaperProtocol
from tools.evaluation.cameras import CameraPair
from tools.evaluation.hue import wrong_hue
from tools.evaluation.methods import methods
from tools.evaluation.metrics import BORDER, psnr, quality
from tools.evaluation.scene_sets import cut
from tools.evaluation.tiles import Tile
from tools.scenes.load import load_scene

PERIOD = 6
TILE = Tile.of_period(PERIOD)
MEASURES = "10 %", "25 %", "median", "whole", "hue"
Figures = dict[str, list[float]]
"""The MEASURES of each method; those of luminance alone have no hue."""
PAIRS = ("best", "rival"), ("best light", "BM3D light")


def rivals(rgb: FloatArray, sigma: float) -> Figures:
    """Figures of Bayer + BM3D + Menon and of BM3D on luminance, if the packages are installed."""
    found: Figures = {}
    method = methods()["bm3d+menon" if sigma else "menon"]
    if method.missing is None:
        found["rival"] = measured(method.render(CameraPair(PaperProtocol(sigma), 0, rgb, TILE.pattern, None)), rgb)
    if sigma and method.missing is None:
        import bm3d

        filled = recover_luminance(CameraPair(PaperProtocol(sigma), 0, rgb, TILE.pattern, None).sparse, PAPER.luminance)
        found["BM3D light"] = measured_light(np.asarray(bm3d.bm3d(filled.astype(np.float64), sigma), np.float32), rgb)
    return found


def measured(picture: FloatArray, rgb: FloatArray) -> list[float]:
    """The MEASURES of a picture."""
    inner = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    return [*quality(picture, rgb).rgb[:3], psnr(picture, rgb, BORDER), 100 * float(wrong_hue(picture[inner], rgb[inner]).mean())]


def measured_light(luminance: FloatArray, rgb: FloatArray) -> list[float]:
    """The MEASURES of a panchromatic plane but hue, as the luminance of the grey picture that sums to it."""
    grey, truth = (np.repeat(plane[..., None] / np.float32(3), 3, axis=2) for plane in (luminance, rgb.sum(axis=2)))
    return [*quality(grey, truth).luminance[:3], psnr(grey, truth, BORDER), np.nan]


def kept_rivals(rgb: FloatArray, name: str, sigma: float, folder: Path | None) -> Figures:
    """The figures of `rivals`, from the folder if it has them."""
    place = folder / f"{name}-{sigma:g}.json" if folder else None
    if place and place.exists():
        kept: Figures = json.loads(place.read_text())
        return kept
    found = rivals(rgb, sigma)
    if place and found:
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(json.dumps(found))
    return found


def figures(rgb: FloatArray, sigma: float) -> Figures:
    """Figures of the presets `paper` and `best`."""
    mosaic = CameraPair(PaperProtocol(sigma), 0, rgb, TILE.pattern, None).sparse
    best = render(mosaic, BEST).rgb
    found = {"paper": measured(render(mosaic, PAPER).rgb, rgb), "best": measured(best, rgb)}
    return found | {"best light": measured_light(best.sum(axis=2), rgb)}


def main() -> None:
    """Print the table, and for each noise the mean over the scenes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="SCENE")
    parser.add_argument("--sigma", nargs="+", type=float, default=[0, 0.01, 0.03])
    parser.add_argument("--rivals", type=Path, metavar="DIR", help="folder that keeps the figures of the rivals")
    parser.add_argument("--only-rivals", action="store_true", help="only fill that folder")
    arguments = parser.parse_args()
    print(f"{'dB; hue in %':42}" + "".join(f"{name:>8}" for name in MEASURES))
    margins: dict[tuple[float, str], list[list[float]]] = {}
    for source in arguments.scenes:
        try:
            rgb = cut(load_scene(source).rgb)
        except InputError as error:
            raise SystemExit(f"{source}: {error}") from None
        for sigma in arguments.sigma:
            name = Path(source).stem
            found = kept_rivals(rgb, name, sigma, arguments.rivals)
            if arguments.only_rivals:
                continue
            found |= figures(rgb, sigma)
            for method, values in found.items():
                print(f"{name:24}{sigma:6g}  {method:10}" + "".join(f"{value:8.2f}" for value in values), flush=True)
            for ours, theirs in PAIRS:
                if theirs in found:
                    margins.setdefault((sigma, ours), []).append([a - b for a, b in zip(found[ours], found[theirs], strict=True)])
    for (sigma, ours), found_margins in margins.items():
        worst = [*np.min(found_margins, axis=0)[:4], np.max(found_margins, axis=0)[4]]
        for how, total in (("mean", np.mean(found_margins, axis=0)), ("worst", worst)):
            title = f"{ours} minus its rival, {sigma:g}, {how}"
            print(f"{title:42}" + "".join(f"{value:+8.2f}" for value in total))


if __name__ == "__main__":
    main()
