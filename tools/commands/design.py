"""Which tile of filters should a sensor have? Search tiles for the light that it works in, for what matters, and within limits.

A fast judge expects the error of each tile from the statistics of photographs. With --photographs, the best dozen are rendered and
measured as `evaluate` does. Writes design.html, and judged.json, from which an interrupted search goes on.
"""

import argparse
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from shared import CfaPattern
from shared.errors import InputError
from shared.pattern import PERIODS
from shared.processors import processors
from shared.writing import write_durably
from tools.host.console import Console
from tools.host.jobs import output_folder, refuse_existing
from tools.host.memory import allowed_memory
from tools.host.versions import program_version

from .options import add, amount, count, factor, natural, option

if TYPE_CHECKING:
    from tools.evaluation.design.judge import Light
    from tools.evaluation.design.proposals import Proposal
    from tools.evaluation.figures import Figures
    from tools.evaluation.page.gallery import Exhibit

_PAGE, _STATE = "design.html", "judged.json"
_DOUBT = "Renders make less of scattered sites than the fast judge expects: let photographs decide (--photographs)."
_SIGMAS = (0.0, 0.01, 0.03)
_WEIGHTS = {
    "luminance": (0.0, "luminance of whole pictures"),
    "colour": (0.0, "colour of whole pictures"),
    "worst": (1.0, "colour where it is finest"),
    "whole": (1.0, "all channels of whole pictures"),
}
"""What matters: its usual weight, and what it is."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma design`."""
    add(parser, "output", files="the results")
    light = parser.add_argument_group("light, one or more; all tiles have the same exposure")
    option(light, "--sigma S ...", "additive noise, scene units (default: 0 0.01 0.03)", type=factor)
    option(light, "--photons N ...", "instead: photons that W counts in white at full exposure", type=factor)
    option(light, "--read-noise E", "beside the photons' noise, electrons", type=amount, default=3.0)
    what = parser.add_argument_group("what matters: weights")
    for name, (usual, weighted) in _WEIGHTS.items():
        option(what, f"--{name} WEIGHT", weighted, type=amount, default=usual)
    limits = parser.add_argument_group("limits")
    option(limits, "--channels LETTERS", "colour filters, each of which a tile has", default="RGB")
    option(limits, "--sizes K ...", f"pixels, {PERIODS[0]} to {PERIODS[-1]}", type=int, default=[3, 4, 5, 6])
    option(limits, "--share LEAST MOST", "of panchromatic pixels", type=factor, default=[0.5, 1.0])
    option(limits, "--sites ROWS", "where filters can be, as XW/WW: W marks places without (default: anywhere)", default="")
    search = parser.add_argument_group("the search")
    option(search, "--steps N", "of annealing, for each size", type=natural, default=400)
    option(search, "--seed N", "of annealing, and of the photographs' noise", type=natural, default=0)
    slow = parser.add_argument_group("the slow judge")
    option(slow, "--photographs SCENE ...", "photographs, or folders of them, to render")
    option(slow, "--crop PIXELS", "use only the middle of each", type=count)
    add(slow, "workers", "max-memory", things="processes", usual="one per core, as memory allows")
    option(parser, "--overwrite", "replace the page of an earlier search; what was judged and measured is kept")
    add(parser, "json", each="tile")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Search, measure, and write the page; returns the exit code."""
    from tools.evaluation.design.judge import FastJudge
    from tools.evaluation.design.page import page
    from tools.evaluation.design.proposals import Proposal, by_measurement, proposed, records, text_table
    from tools.evaluation.design.search import Judged, Limits, Search

    weights = {name: getattr(arguments, name) for name in _WEIGHTS}
    if not any(weights.values()):
        raise InputError("nothing matters: give one of --luminance, --colour, --worst and --whole a weight")
    sites = tuple(arguments.sites.split("/")) if arguments.sites else ()
    limits = Limits(arguments.channels, tuple(sorted(set(arguments.sizes))), arguments.share[0], arguments.share[1], sites)
    lights = _lights(arguments)
    judge = FastJudge.of(limits.letters, lights)
    if arguments.photographs and judge.unmeasured:
        raise InputError(f"no render fills in the channel that --channels {judge.letters} leaves out; leave --photographs out, too")
    folder = output_folder(arguments.output)
    if not arguments.overwrite:
        refuse_existing([folder / _PAGE])
    known = repr((judge.letters, [(light.shot, light.read) for light in lights], judge.spectra.encode()))
    judged = Judged(judge, hashlib.sha256(known.encode()).hexdigest()[:16], folder / _STATE)
    search = Search(judged, limits, weights, arguments.steps, arguments.seed)
    if judged.known:
        console.note(f"{len(judged.known)} tiles are known from an earlier run")
    with console.progress("design") as progress:
        found = search.run(progress)
    every = [Proposal.of(search, judge, tile) for tile in found]
    shown = proposed(search, judge, every)
    texts = [light.text for light in lights]
    measured, exhibits = _photographed(arguments, shown, lights, folder, console) if arguments.photographs else (None, [])
    if measured:
        shown = by_measurement(shown, measured, weights)
    weighted = ", ".join(f"{name} {weight:g}" for name, weight in weights.items() if weight)
    facts = [f"{len(found)} tiles were judged under {', '.join(texts)}. Weights: {weighted}.", *[_DOUBT] * (not measured)]
    photographs = len(measured.study.scenes) if measured else 0
    content = page(shown, every, texts, photographs, exhibits, facts, f"panchroma {program_version()}")
    write_durably(folder / _PAGE, content, overwrite=arguments.overwrite)
    console.say(*text_table(shown), str(folder / _PAGE))
    for record in records(shown, texts):
        console.record(**record)
    return 0


def _lights(arguments: argparse.Namespace) -> "list[Light]":
    from tools.evaluation.design.judge import Light

    if arguments.sigma and arguments.photons:
        raise InputError("--sigma and --photons are two kinds of noise; give one of them")
    if arguments.photons:
        return [Light.of_photons(photons, arguments.read_noise) for photons in arguments.photons]
    return [Light.of_sigma(sigma) for sigma in arguments.sigma or _SIGMAS]


def _photographed(
    arguments: argparse.Namespace, shown: "Sequence[Proposal]", lights: "Sequence[Light]", folder: Path, console: Console
) -> "tuple[Figures, list[Exhibit]]":
    """What the slow judge says of the tiles, and crops."""
    from tools.evaluation.design.proposals import photographed
    from tools.evaluation.page.gallery import render_gallery
    from tools.evaluation.scene_sets import Reading
    from tools.evaluation.team import Team
    from tools.evaluation.tiles import Tile, chosen_tiles

    team = Team(console, arguments.workers or processors(), allowed_memory(arguments.max_memory))
    tiles = chosen_tiles((), (Tile.named(CfaPattern(each.tile), each.letters) for each in shown))
    levels, reading = [light.protocol for light in lights], Reading(largest=arguments.crop)
    measured = photographed(tiles, levels, arguments.photographs, folder, team, reading, arguments.seed)
    return measured, render_gallery(measured, team)
