"""Is this camera better, where, and by how much? Photograph scenes with it and with a Bayer camera, and compare the renderings.

Writes evaluation.html (one page that works offline), evaluation.json and evaluation.csv. Results are kept in DIR/results as they
are made: an interrupted run continues where it stopped. --resume adds to a finished one: of another method or noise level only its
own results are measured. --overwrite measures all of them again.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from shared.errors import InputError, OutputError
from shared.pattern import PERIODS
from shared.processors import processors
from shared.tiles import TILES
from shared.writing import write_durably
from tools.batch.cluster import SchedulerGoneError, absolute_path, connected
from tools.batch.console import Console
from tools.batch.jobs import FAILED, output_folder, refuse_existing
from tools.batch.memory import allowed_memory
from tools.commands.font_folder import temporary_font_folder
from tools.evaluation.figures import Figures
from tools.evaluation.report import plain_text
from tools.io.versions import program_version
from tools.simulation.pattern_text import read_pattern

from .options import add, add_protocol, count, option, protocol_of, uses_scheduler

if TYPE_CHECKING:
    from tools.evaluation.study import Study, Task
    from tools.evaluation.team import Team
    from tools.evaluation.tiles import Tile

_PAGE, _JSON, _CSV = "evaluation.html", "evaluation.json", "evaluation.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma evaluate`."""
    scenes = "camera RAW, picture, builtin:WIDTHxHEIGHT, or a folder with them in it or below"
    option(parser, "SCENE ...", scenes, dest="scenes")
    add(parser, "output", files="the results")
    light = parser.add_argument_group("light and noise")
    add_protocol(light, nargs="+")
    add(light, "seed", "linear")
    what = parser.add_argument_group("what is compared")
    periods = "period of the paper's pattern; with several values the periods are compared (default: 6, unless there is --pattern)"
    option(what, "--period K ...", periods, type=int)
    option(
        what,
        "--pattern LETTERS ...",
        "other patterns, compared under the same light: each the letters of a tile, as WBWG/BWGW/WGWR/GWRW, its name "
        f"({', '.join(map(str.casefold, TILES))}), or a file; C, M and Y are made of red, green and blue",
    )
    option(what, "--methods NAME ...", "methods to compare (default: all installed; an unknown name lists them)")
    rivals = "compare anybody's network for Bayer mosaics, too; FILE.json beside it says how it is fed"
    option(what, "--rival FILE.onnx ...", rivals)
    option(what, "--crop PIXELS", "use only the middle of each scene, for a quick look", type=count)
    run_ = parser.add_argument_group("the run")
    add(run_, "workers", things="processes", usual="one per core, as memory allows")
    add(run_, "scheduler", "scheduler-file", "max-memory", "resume", "overwrite", "dry-run")
    option(run_, "--no-page", "write only the figures")
    add(parser, "json", each="scene")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Measure what is missing and write the page and the tables; returns the exit code."""
    from tools.batch.html import without_folders
    from tools.evaluation.page.gallery import render_gallery
    from tools.evaluation.page.page import build_page
    from tools.evaluation.study import FOLDER, Cache, collect, tasks
    from tools.evaluation.tables import encode_csv, encode_json
    from tools.evaluation.team import Team

    folder = output_folder(arguments.output, dry_run=arguments.dry_run)
    outputs = [folder / name for name in (_PAGE, _JSON, _CSV) if not arguments.no_page or name != _PAGE]
    if not (arguments.overwrite or arguments.resume or arguments.dry_run):
        try:
            refuse_existing(outputs)
        except OutputError as error:
            raise OutputError(f"{error}, or `resume=True` to keep the results that are up to date") from None
    team = Team(console, arguments.workers or processors(), allowed_memory(arguments.max_memory))
    study, failures, left_out = _study(arguments, console, team)
    todo, there = tasks(study, folder.absolute() if uses_scheduler(arguments) else folder, anew=arguments.overwrite)
    if arguments.dry_run:
        return _list(todo, there, failures, console)
    if arguments.overwrite:  # before any is made, so that none that fails leaves an old one
        Cache(folder / FOLDER).remove([cell.name for cell in study.cells()])
    temporary_font_folder()  # a rival's package imports matplotlib
    if there:
        console.note(f"{there} results are kept from an earlier run")
    try:
        failures += _measure(arguments, team, todo)
    except SchedulerGoneError as error:
        console.error(str(error))
        return FAILED
    results = collect(study, folder)
    figures = Figures(study, results)
    program = f"panchroma {program_version()}"
    page = b""
    if not arguments.no_page:
        try:
            exhibits = render_gallery(figures, team)
        except InputError as error:  # a file that has changed since it was measured
            console.error(str(error))
            failures, exhibits = [*failures, str(error)], []
        named_files = [*arguments.scenes, *arguments.rival]
        page = build_page(figures, exhibits, program, [without_folders(line, named_files) for line in (*failures, *left_out)])
    contents = {_PAGE: page, _JSON: encode_json(figures, program, failures, left_out), _CSV: encode_csv(figures)}
    for path in outputs:
        write_durably(path, contents[path.name], overwrite=arguments.overwrite or arguments.resume)
    console.say(*plain_text(figures).split("\n"))
    console.say(", ".join(str(path) for path in outputs))
    for scene in study.scenes:
        console.record(source=scene.source, ok=True, group=scene.group, width=scene.columns, height=scene.rows)
    return FAILED if failures else 0


def _study(arguments: argparse.Namespace, console: Console, team: "Team") -> tuple["Study", list[str], list[str]]:
    """The requested study, with the scenes that can be read; a line for each scene that cannot; and remarks on what is left out."""
    from tools.evaluation.methods import choose, default_names, missing_packages
    from tools.evaluation.scene_sets import Reading
    from tools.evaluation.study import Study

    protocol, wanted = protocol_of(arguments)
    levels = protocol.levels(wanted)
    if wrong := [name for name in arguments.rival if not name.endswith(".onnx")]:
        raise InputError(f"--rival is {wrong[0]}, expected a file that ends with .onnx")
    place = absolute_path if uses_scheduler(arguments) else str
    methods = choose([*(arguments.methods or default_names()), *map(place, arguments.rival)])
    if not arguments.methods and (missing := missing_packages()):
        console.note(f"some methods are left out because these packages are not installed: {', '.join(missing)}")
    tiles = _tiles(arguments)
    channels = dict.fromkeys(tile.pattern.channels for tile in tiles)  # each once, in their order
    reading = Reading(arguments.linear, arguments.crop, tuple(sorted(channels, key=len, reverse=True)))
    scenes, failures, left_out = team.read(list(map(place, arguments.scenes)), Path(arguments.output), reading)
    names = tuple(each.name for each in methods)
    networks = tuple((each.name, each.file) for each in methods if each.file)
    study = Study(tuple(scenes), names, levels, tiles, arguments.seed, reading, networks)
    made, without = study.remarks()
    console.note(*made, *without)
    return study, failures, [*left_out, *without]


def _tiles(arguments: argparse.Namespace) -> "tuple[Tile, ...]":
    """The patterns that --period and --pattern name together; K = 6 if neither is there."""
    from tools.evaluation.tiles import Tile, chosen_tiles

    others = [Tile.named(read_pattern(text), text) for text in arguments.pattern]
    periods = arguments.period or ([] if others else [6])
    for period in periods:
        if period not in PERIODS:
            raise InputError(f"--period is {period}, expected {PERIODS[0]} to {PERIODS[-1]}")
    return chosen_tiles(periods, others)


def _measure(arguments: argparse.Namespace, team: "Team", todo: "list[Task]") -> list[str]:
    if not (uses_scheduler(arguments) and todo):
        return team.measure(todo)
    with connected(arguments.scheduler, arguments.scheduler_file) as client:
        return replace(team, client=client).measure(todo)


def _list(todo: "list[Task]", there: int, failures: list[str], console: Console) -> int:
    """Print the work of a --dry-run."""
    for task in todo:
        console.say(task.title)
        for cell in task.cells:
            facts = {"pattern": cell.pattern or None, "period": cell.tile and cell.tile.period}
            console.record(source=cell.scene.source, level=cell.level.level, method=cell.method, **facts, dry_run=True)
    console.say(f"{sum(len(task.cells) for task in todo)} results to make, {there} kept from an earlier run")
    return FAILED if failures else 0
