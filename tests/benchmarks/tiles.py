"""Does the fast judge of `panchroma design` rank tiles as renders of photographs do? Rank correlations, by figure and light.

    python -m tests.benchmarks.tiles SCENE... -o DIR --crop 252

`best` has networks for some of these tiles only; `--method unlearned` compares tiles alone. Results are kept in DIR.
"""

from pathlib import Path

import numpy as np

from shared import CfaPattern
from shared.processors import processors
from shared.tiles import TILES
from tests.benchmarks.harness import options
from tools.evaluation.design.judge import FastJudge, Figures, Light
from tools.evaluation.design.proposals import METHOD, photographed, slow_figures, spearman
from tools.evaluation.scene_sets import Reading
from tools.evaluation.team import Team
from tools.evaluation.tiles import Tile, chosen_tiles
from tools.host.console import Console
from tools.host.memory import allowed_memory

SIGMAS = (0.0, 0.01, 0.03)
OTHERS = (
    "RGWW/BWWW/WWWW/WWWW",
    "RGWWWW/BWWWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW",
    "RWW/WGW/WWB",
    "RWGW/WWWW/GWBW/WWWW",
    "RWWWW/WWGWW/WWWWB/WGWWW/WWWWW",
    "RWWGWW/WWWWWW/WWWWWW/GWWBWW/WWWWWW/WWWWWW",
    "RWWWGWWW/WWWWWWWW/WWWWWWWW/WWWWWWWW/GWWWBWWW/WWWWWWWW/WWWWWWWW/WWWWWWWW",
)


def main() -> None:
    """Measure what is missing, and print the table."""
    output = {"type": Path, "required": True, "metavar": "DIR"}
    arguments = options(__doc__, "+", output=output, crop={"type": int}, method=METHOD)
    arguments.output.mkdir(exist_ok=True)
    texts = [name for name in TILES if name != "paper"] + list(OTHERS)
    tiles = chosen_tiles(range(3, 9), (Tile.named(CfaPattern.of_letters(text), text) for text in texts))
    lights = [Light.of_sigma(sigma) for sigma in SIGMAS]
    team, levels = Team(Console(), processors(), allowed_memory(None)), [light.protocol for light in lights]
    reading = Reading(largest=arguments.crop)
    measured = photographed(tiles, levels, arguments.scenes, arguments.output, team, reading, method=arguments.method)
    slow = np.array([slow_figures(measured, tile.pattern.tile) for tile in tiles])
    judge = FastJudge.of("RGB", lights)
    fast = np.array([judge(tile.pattern.tile) for tile in tiles])
    scattered = np.array([tile.pattern.is_scattered for tile in tiles])
    families = {"all": scattered | True, "one block": ~scattered, "scattered": scattered}
    print(f"| {arguments.method}: {', '.join(Figures._fields)} | {' | '.join(light.text for light in lights)} |")
    for name, chosen in families.items():
        cells = [
            ", ".join(
                f"{spearman(fast[chosen, light, figure].tolist(), slow[chosen, light, figure].tolist()):.2f}"
                for figure in range(len(Figures._fields))
            )
            for light in range(len(lights))
        ]
        print(f"| {chosen.sum()} tiles, {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
