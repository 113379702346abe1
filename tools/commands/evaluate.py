"""Is this camera better, where, and by how much? Photograph scenes with it and with a Bayer camera,
and compare the renderings.

Writes evaluation.html (one page that works offline), evaluation.json, evaluation.csv and the plots,
evaluation.svg. Results are kept in DIR/results as they are made: an interrupted run continues where
it stopped. --resume measures only what is missing in a finished one, too; the page then shows what
this command names, no more. --overwrite measures all of it again.
"""

import argparse
from pathlib import Path

from ...shared.errors import InputError
from ...shared.processors import processors
from ..batch.console import Console
from ..batch.jobs import FAILED, output_folder, refuse_existing, write_report
from ..batch.memory import allowed_memory
from ..evaluation.cameras import Tile, channels_of
from ..evaluation.evaluation_page import build_page, plots_svg, render_crops
from ..evaluation.figures import Figures
from ..evaluation.methods import choose, default_names, missing_packages
from ..evaluation.scene_sets import Reading
from ..evaluation.study import Case, Study, Team, collect, missing_cases, remove_results
from ..evaluation.tables import encode_csv, encode_json, plain_text
from ..io.page import without_folders
from ..io.scene import RGB
from ..io.versions import program_version
from ..simulation.pattern_text import read_pattern
from ..simulation.protocols import chosen_protocol
from .options import TILE_NAMES, add, count, names, numbers, pixel_limit

USAGE = "SCENE ... -o DIR"
_COMPARED = "--sigma 0,0.01 --methods best,paper,dlmmse --crop 600"
EXAMPLE = f"panchroma evaluate photographs -o results {_COMPARED}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma evaluate`."""
    scenes = "camera RAW, picture, builtin:WIDTHxHEIGHT, or a folder with them in it or below"
    parser.add_argument("scenes", metavar="SCENE", nargs="+", help=scenes)
    add(parser, "output", help="folder for the results, created if missing")
    light = parser.add_argument_group("light and noise: one or several levels, with commas")
    add(light, "sigma", "light", type=numbers(example="0,0.01"))
    add(light, "linear")
    what = parser.add_argument_group("what is compared: one or several, with commas")
    letters = "letters of a tile such as WBWG/BWGW/WGWR/GWRW, or a file"
    known = f"K=4 (the paper's in 4 x 4 pixels), a name ({TILE_NAMES}), {letters}"
    made = "C, M and Y are made of red, green and blue"
    patterns = f"patterns of filters, compared under the same light: {known}; {made} (default: K=6)"
    add(what, "pattern", metavar="PATTERN,...", type=names, default=["K=6"], help=patterns)
    own = "yours by FILE.py:FUNCTION or MODULE:FUNCTION, which makes a picture of a Mosaic"
    methods = f"methods to compare, {own} (default: all installed; an unknown name lists them)"
    what.add_argument("--methods", metavar="NAME,...", type=names, default=[], help=methods)
    rivals = "network for Bayer mosaics; FILE.json beside it says how it is fed; repeat it for more"
    what.add_argument("--rival", metavar="FILE.onnx", action="append", default=[], help=rivals)
    crop = "use only the middle of each scene, for a quick look"
    what.add_argument("--crop", metavar="PIXELS", type=count, help=crop)
    run_ = parser.add_argument_group("the run")
    add(run_, "jobs", help="processes at a time (default: one per core, as memory allows)")
    add(run_, "max-memory", "resume", "overwrite", "dry-run")
    add(parser, "json")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Measure what is missing and write the page and the tables; returns the exit code."""
    folder = output_folder(arguments.output, dry_run=arguments.dry_run)
    outputs = [folder / f"evaluation.{ending}" for ending in ("html", "json", "csv", "svg")]
    if not (arguments.overwrite or arguments.resume):
        refuse_existing(outputs, "`resume=True` adds to it, `overwrite=True` measures all again")
    team = Team(console, arguments.jobs or processors(), allowed_memory(arguments.max_memory))
    study, failures = _study(arguments, console, team)
    if not study.scenes:
        return FAILED
    todo, kept = missing_cases(study, folder, anew=arguments.overwrite)
    if arguments.dry_run:
        return _list(todo, kept, failures, console)
    if arguments.overwrite:  # before any is made, so that none that fails leaves an old one
        remove_results(study, folder)
    if kept:
        console.note(f"{kept} results are kept from an earlier run")
    failures += team.measure(study, folder, todo)
    if not (results := collect(study, folder)):
        console.error("nothing could be measured; the lines above say why")
        return FAILED
    figures, program = Figures(study, results), f"panchroma {program_version()}"
    own = [source.rpartition(":")[0] or source for _, source in study.sources]
    missing = [without_folders(line, [*arguments.scenes, *own]) for line in failures]
    stated = {name: value for name, value in vars(arguments).items() if value}
    contents = (
        lambda: build_page(figures, render_crops(figures, team), program, missing),
        lambda: encode_json(figures, program, failures, stated),
        lambda: encode_csv(figures),
        lambda: plots_svg(figures),
    )
    replace, made = arguments.overwrite or arguments.resume, zip(outputs, contents, strict=True)
    written = [str(path) for path, make in made if write_report(path, make, console, replace)]
    console.say(*plain_text(figures).split("\n"))
    console.say(", ".join(written))
    incomplete = {case.scene for case in study.cases() if case not in results}
    for scene in study.scenes:
        facts = {"group": scene.group, "width": scene.columns, "height": scene.rows}
        console.record(source=scene.source, ok=scene not in incomplete, **facts)
    return FAILED if failures or len(written) < len(outputs) else 0


def _study(arguments: argparse.Namespace, console: Console, team: Team) -> tuple[Study, list[str]]:
    """The requested study, with the scenes that can be read; a line for each scene that cannot."""
    protocol, requested = chosen_protocol(arguments.sigma, arguments.light)
    levels = protocol.levels(requested)
    if wrong := [name for name in arguments.rival if not name.endswith(".onnx")]:
        raise InputError(f"--rival is {wrong[0]}, expected a file that ends with .onnx")
    methods = choose([*(arguments.methods or default_names()), *arguments.rival])
    if not arguments.methods and (missing := missing_packages()):
        console.note(f"some methods are left out; packages not installed: {', '.join(missing)}")
    tiles = dict.fromkeys(Tile.named(read_pattern(text), text) for text in arguments.pattern)
    channels, *others = dict.fromkeys(channels_of(tile.pattern) for tile in tiles)
    if others:
        raise InputError(f"no scene fits patterns for {channels} and for {others[0]}")
    if channels != RGB and (bayer := [method for method in methods if not method.ours]):
        methods = [method for method in methods if method.ours]
        left_out = ", ".join(method.name for method in bayer)
        console.note(f"a Bayer camera has red, green and blue alone; left out: {left_out}")
    names = [tile.name for tile in tiles]
    if alike := [name for name in names if names.count(name) > 1]:
        raise InputError(f"different patterns are called {alike[0]!r}; rename the file of one")
    reading = Reading(arguments.linear, arguments.crop, channels, pixel_limit())
    scenes, failures = team.read(arguments.scenes, Path(arguments.output), reading)
    chosen = tuple(method.name for method in methods)
    own_sources = tuple((method.name, method.source) for method in methods if method.source)
    return Study(tuple(scenes), chosen, levels, tuple(tiles), reading, own_sources), failures


def _list(todo: list[Case], kept: int, failures: list[str], console: Console) -> int:
    """Print the work of a --dry-run."""
    for case in todo:
        console.say(case.title)
        facts = {"source": case.scene.source, "level": case.level.level, "method": case.method}
        facts |= {"pattern": case.tile and case.tile.name, "period": case.tile and case.tile.period}
        console.record(**facts, dry_run=True)
    console.say(f"{len(todo)} results to make, {kept} kept from an earlier run")
    return FAILED if failures else 0
