"""Try the proposals of the paper's section 5: python -m tests.benchmarks.section_5 SCENE... [--study STUDY...] [--sigma S...]

Studies, each a table in Markdown:

steps    other steps of the reconstruction, cheaper and dearer
bands    eight narrow bands, against three channels and a guess, and against a mosaic of bands; takes spectral:WIDTHxHEIGHT

The first takes photographs, and prints means over all of them. PSNR is in dB: of 10 x 10 patches the median or the 10 % quantile,
or that of the whole image, always in the scene's red, green and blue, whatever the filters are. All cameras get the same light.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from shared.errors import InputError
from tests.benchmarks.harness import options
from tools.camera.protocols import PaperProtocol, Protocol, SensorProtocol
from tools.evaluation.scene_sets import cut
from tools.scenes.drawn.spectral import BANDS
from tools.scenes.load import load_scene
from tools.scenes.scene import Scene

from . import bands, steps

Rows = dict[tuple[str, str], list[list[float]]]
"""Figures of a table: by noise and by what is tried, one list for each scene."""
Study = Callable[[Scene, Protocol], Iterator[tuple[str, list[float]]]]
# Title, names of the figures, study.
STUDIES: dict[str, tuple[str, tuple[str, ...], Study]] = {
    "steps": ("Steps of the reconstruction", steps.MEASURES, steps.steps),
    "bands": ("Eight bands", bands.MEASURES, bands.bands),
}


def main() -> None:
    """Print the tables."""
    studies = {"nargs": "+", "choices": STUDIES, "default": list(STUDIES)}
    noise = {"nargs": "*", "type": float, "default": [0, 0.01, 0.03], "help": "additive noise, as in the paper"}
    light = {"nargs": "*", "type": float, "default": [], "help": "noise of a sensor in this part of the scene's light"}
    size = {"type": int, "default": 600, "metavar": "PIXELS", "help": "of each scene, the middle (default: %(default)s)"}
    arguments = options(__doc__, "+", study=studies, sigma=noise, light=light, size=size)
    levels = [*map(PaperProtocol, arguments.sigma), *map(SensorProtocol, arguments.light)]
    photographs: dict[str, Rows] = {}
    for source in arguments.scenes:
        try:
            scene = load_scene(source)
            scene = replace(scene, rgb=cut(scene.rgb, arguments.size))
        except InputError as error:
            raise SystemExit(f"{source}: {error}") from None
        drawn: dict[str, Rows] = {}
        for study in arguments.study:
            if (study == "bands") == (scene.channels == BANDS):
                rows = (drawn if study == "bands" else photographs).setdefault(study, {})
                for level in levels:
                    for name, figures in STUDIES[study][2](scene, level):
                        rows.setdefault((level.text, name), []).append(figures)
        print_tables(drawn, source)
    print_tables(photographs, "means over the photographs")


def print_tables(tables: dict[str, Rows], what: str) -> None:
    """Print the tables of some scenes in Markdown: means over them."""
    for study, rows in tables.items():
        title, measures, _ = STUDIES[study]
        print(f"\n### {title}: {what}\n\n| | | {' | '.join(measures)} |\n|{'---|' * (len(measures) + 2)}")
        for (level, name), found in rows.items():
            print(f"| {level} | {name} | {' | '.join(f'{figure:.3g}' for figure in np.mean(found, axis=0))} |")
        print(flush=True)


if __name__ == "__main__":
    main()
