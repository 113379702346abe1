"""Measure low light: python -m tests.benchmarks.low_light SCENE... [--sigma 0 0.01 0.03] [--rivals DIR]

For each scene and noise, 25 % quantile and median of the PSNR of all 10 x 10 patches. RGB: `paper`, `best`, and Bayer + BM3D on
its planes + Menon 2007. Luminance: `best`, and BM3D on the panchromatic plane whose holes the paper's method has filled. The rivals
need the packages `bm3d` and `colour-demosaicing`; they are slow, so that --rivals DIR keeps their figures.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from offline import BEST, PAPER, render
from offline.luminance import recover_luminance
from shared.arrays import FloatArray
from shared.errors import InputError
from tools.evaluation.cameras import CameraPair
from tools.evaluation.methods import methods
from tools.evaluation.metrics import BORDER, PATCH, quality
from tools.evaluation.protocol import Protocol, cut
from tools.scenes.load import load_scene

PROTOCOL = Protocol()
PERIOD = 6
Figures = dict[str, tuple[float, float]]  # 25 % quantile and median


def rivals(rgb: FloatArray, sigma: float) -> Figures:
    """Figures of Bayer + BM3D + Menon and of BM3D on luminance, if the packages are installed."""
    found: Figures = {}
    name = "bm3d+menon" if sigma else "menon"
    method = methods()[name]
    if method.missing is None:
        found["rival"] = quality(method.render(CameraPair(PROTOCOL, sigma, rgb, PERIOD, None)), rgb).rgb[1:3]
    if sigma and method.missing is None:
        import bm3d

        filled = recover_luminance(PROTOCOL.sparse_shot(rgb, sigma, PERIOD), PAPER.luminance)
        found["bm3d"] = light_quality(np.asarray(bm3d.bm3d(filled.astype(np.float64), sigma), np.float32), rgb)
    return found


def light_quality(luminance: FloatArray, rgb: FloatArray) -> tuple[float, float]:
    """(25 % quantile, median) for a panchromatic plane, measured as the luminance of the grey picture that sums to it."""
    grey = np.repeat(luminance[..., None] / np.float32(3), 3, axis=2)
    return quality(grey, rgb, PATCH, BORDER).luminance[1:3]


def kept_rivals(rgb: FloatArray, name: str, sigma: float, folder: Path | None) -> Figures:
    """The figures of `rivals`, from the folder if it has them."""
    place = folder / f"{name}-{sigma:g}.json" if folder else None
    if place and place.exists():
        return {key: (low, middle) for key, (low, middle) in json.loads(place.read_text()).items()}
    found = rivals(rgb, sigma)
    if place and found:
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(json.dumps(found))
    return found


def figures(rgb: FloatArray, sigma: float) -> Figures:
    """Figures of the presets `paper` and `best`."""
    mosaic = PROTOCOL.sparse_shot(rgb, sigma, PERIOD)
    best = quality(render(mosaic, BEST).rgb, rgb)
    return {"paper": quality(render(mosaic, PAPER).rgb, rgb).rgb[1:3], "best": best.rgb[1:3], "light": best.luminance[1:3]}


def shown(found: Figures) -> Iterator[str]:
    """The columns of one line of the table."""
    for key in ("paper", "best", "rival", "light", "bm3d"):
        low, middle = found.get(key, (np.nan, np.nan))
        yield f"{low:6.1f}{middle:6.1f}"
    for ours, theirs in (("best", "rival"), ("light", "bm3d")):
        if ours in found and theirs in found:
            yield f"{found[ours][0] - found[theirs][0]:+6.1f}{found[ours][1] - found[theirs][1]:+6.1f}"


def main() -> None:
    """Print the table, and for each noise the mean over the scenes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="SCENE")
    parser.add_argument("--sigma", nargs="+", type=float, default=[0, 0.01, 0.03])
    parser.add_argument("--rivals", type=Path, metavar="DIR", help="folder that keeps the figures of the rivals")
    parser.add_argument("--only-rivals", action="store_true", help="only fill that folder")
    arguments = parser.parse_args()
    print(
        f"{'25 % and median, dB':22}{'paper':>12}{'best':>14}{'rival':>14}{'light':>14}{'BM3D light':>14}{'RGB':>14}{'light':>14}"
    )
    margins: dict[float, list[float]] = {}
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
            if "rival" in found:
                margins.setdefault(sigma, []).append(found["best"][1] - found["rival"][1])
            print(f"{name:16}{sigma:6g}" + "  ".join(shown(found)), flush=True)
    for sigma, values in margins.items():
        print(f"sigma {sigma:g}: best minus rival, {len(values)} scenes: mean {np.mean(values):+.2f}, least {min(values):+.2f}")


if __name__ == "__main__":
    main()
