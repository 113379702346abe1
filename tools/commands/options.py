"""The options that several commands have, each said once, and the kinds of values that options take."""

import argparse
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from shared import Camera, CfaPattern, read_camera
from shared.calibration import BITS
from shared.errors import InputError
from shared.pattern import PERIODS
from shared.reading import MAX_PIXELS
from shared.tiles import TILES
from tools.batch.memory import parse_bytes
from tools.simulation.noise import PROTOCOLS, PaperProtocol, Protocol, chosen_protocol
from tools.simulation.pattern_text import read_pattern

T = TypeVar("T")

_PERIOD = 6
_NAMES = ", ".join(map(str.casefold, TILES))


# --- values ---------------------------------------------------------------------------------------------------------------------


def value(convert: Callable[[str], T], expected: str, fits: Callable[[T], bool] = lambda _: True) -> Callable[[str], T]:
    """The type of an option: what `convert` makes of its text, or a usage error that says what was expected.

    It is one if `convert` raises, and for what does not fit.
    """

    def typed(text: str) -> T:
        try:
            if fits(found := convert(text)):
                return found
        except (ValueError, ZeroDivisionError):
            pass
        raise argparse.ArgumentTypeError(f"{text!r} is not {expected}")

    return typed


def numbers(count: int | None = None, example: str = "1,-0.5") -> Callable[[str], tuple[float, ...]]:
    """The type of an option that takes numbers with commas between them, `count` of them or any number."""
    expected = f"{count or 'a list of'} numbers with commas between them, such as {example}"
    return value(lambda text: tuple(map(float, text.split(","))), expected, lambda found: count in (None, len(found)))


def _factor(text: str) -> float:
    number, slash, divisor = text.partition("/")
    return float(number) / float(divisor if slash else 1)


count = value(int, "a whole number from 1 on", lambda number: number >= 1)
natural = value(int, "a whole number from 0 on", lambda number: number >= 0)
amount = value(float, "a number from 0 on", lambda number: 0 <= number < float("inf"))
factor = value(_factor, "a number, or a fraction such as 1/4")
file_name = value(str, "the name of a file", bool)  # a variable of a shell that is not set would be no option at all otherwise


def text(argument: str) -> str:
    """The text of an argument, which is UTF-8 even where the locale has another encoding, or none (LC_ALL=C)."""
    return os.fsencode(argument).decode("utf-8", "replace")


# --- the table ------------------------------------------------------------------------------------------------------------------

_SHARED: dict[str, tuple[str, str, dict[str, Any]]] = {
    "output": ("-o --output DIR", "folder for {files}, created if missing", {"required": True}),
    "resume": ("--resume", "keep results that are up to date, replace outdated ones", {}),
    "overwrite": ("--overwrite", "replace results that exist already", {}),
    "dry-run": ("--dry-run", "write nothing, only say what would be done", {}),
    "json": ("--json", "print one JSON object per {each} to stdout", {}),
    # What is read.
    "camera": ("--camera FILE", "camera.json: the calibration of the sensor{instead}", {"type": file_name}),
    "pattern": (
        "--pattern LETTERS",
        "the filters of a tile, row by row, W is panchromatic: WBWG/BWGW/WGWR/GWRW; or its name: "
        f"{_NAMES}; or a file with them, one row on each line{{more}}",
        {},
    ),
    "period": (
        "--period K",
        f"of the paper's pattern: pixels from block to block, {PERIODS[0]} to {PERIODS[-1]} (default: {_PERIOD})",
        {"type": int},
    ),
    "origin": ("--origin ROW COLUMN", "position of the first block (default: 0 0)", {"type": int}),
    "sensor-bits": (
        "--sensor-bits N",
        f"bits that the sensor delivers, {BITS[0]} to {BITS[-1]} (default: {{usual}}, or the camera's)",
        {"type": int},
    ),
    "linear": ("--linear", "take the pictures' values as linear light, whatever the files say", {}),
    "max-pixels": ("--max-pixels N", "refuse a file with more pixels than this", {"type": count, "default": MAX_PIXELS}),
    # Noise of a simulated camera: see `add_protocol`.
    "seed": ("--seed N", "seed of the noise", {"type": natural, "default": 0}),
    # What is made.
    "quality": ("--quality N", "quality of a JPEG, 1 (small) to 100 (default: 95){more}", {"type": int}),
    "scale": ("--scale N", "sensor pixels per picture pixel, in each direction; must divide the period", {"type": int}),
    "latest": ("--latest LINK", "keep a symbolic link with this name to the latest shot", {"type": Path}),
    # How it is made.
    "threads": ("-j --threads N", "threads{of} (default: one per core)", {"type": count}),
    "workers": ("--workers N", "{things} at a time (default: {usual})", {"type": count}),
    "max-memory": (
        "--max-memory SIZE",
        "memory for all processes together, for example 4G (default: most of the free memory)",
        {"type": value(parse_bytes, "a size such as 800M or 4G")},
    ),
    "scheduler": ("--scheduler ADDRESS", "do the work on the workers of this dask scheduler, tcp://HOST:PORT", {}),
    "scheduler-file": ("--scheduler-file FILE", "as --scheduler, for the scheduler that wrote this file", {}),
}
"""Option -> how its help shows it, its help, and settings of argparse; a word in braces is replaced by that of the command."""


def option(group: argparse._ActionsContainer, shown: str, help: str, **settings: Any) -> None:  # noqa: A002  argparse's name
    """Add an option, or what is named without one.

    shown: as the help shows it: "-o --output DIR", "--shifts F ..." (a list, by default an empty one), "--origin ROW COLUMN",
        "--json" (a switch).
    settings: of argparse, instead of those that this says; `dest` of what is named without an option.
    """
    words = shown.removesuffix(" ...").split()
    flags = [word for word in words if word.startswith("-")]
    values = tuple(words[len(flags) :])
    said: dict[str, Any] = {"metavar": values[0] if len(values) == 1 else values} if values else {}
    if shown.endswith(" ..."):
        said |= {"nargs": "+", "default": []}
    elif len(values) > 1:
        said["nargs"] = len(values)
    elif not values and not settings:
        said["action"] = "store_true"
    group.add_argument(*flags, help=help, **said | settings)


def add(group: argparse._ActionsContainer, *options: str, **changed: Any) -> None:
    """Add options of the table, in this order.

    changed: the words for those in braces, and settings of argparse that differ from the table's (nargs, default, required).
    """
    settings = {name: changed.pop(name) for name in ("nargs", "default", "required") if name in changed}
    words = {"instead": "", "of": "", "more": ""} | changed
    for each in options:
        shown, said, known = _SHARED[each]
        option(group, shown, said.format(**words), **known | settings)


def add_protocol(group: argparse._ActionsContainer, **settings: Any) -> None:
    """Add --protocol, and the option of each protocol for its level; `protocol_of` reads them. settings: of the levels (nargs)."""
    summaries = "; ".join(f"{name}: {each.summary}" for name, each in PROTOCOLS.items())
    usual = f"(default: that of the level that is given, or {PaperProtocol.name})"
    group.add_argument("--protocol", choices=list(PROTOCOLS), help=f"{summaries} {usual}")
    for each in {each.option: each for each in PROTOCOLS.values()}.values():
        option(group, f"--{each.option} {each.metavar}", each.help, type=factor, **settings)


def add_shots(parser: argparse.ArgumentParser, also: str = "") -> None:
    """Add SHOT, one or more."""
    option(parser, "SHOT ...", f"a DNG written by Panchroma, {also}or a folder with DNGs in it or below", dest="shots")


# --- what they mean together ----------------------------------------------------------------------------------------------------


def protocol_of(arguments: argparse.Namespace) -> tuple[type[Protocol], Any]:
    """The protocol, and the level or levels that are given for it, None without. Raises InputError as `chosen_protocol` does."""
    return chosen_protocol(arguments.protocol, {each.option: getattr(arguments, each.option) for each in PROTOCOLS.values()})


def pattern_of(arguments: argparse.Namespace, known: CfaPattern | None = None) -> CfaPattern:
    """The pattern of --pattern or --period, at --origin. known: that of the camera, for what is not given.

    Raises InputError for both together, for a period outside the supported range, and for what `read_pattern` refuses.
    """
    if arguments.pattern is not None and arguments.period is not None:
        raise InputError("--pattern says where every filter is; leave --period out")
    if arguments.pattern is not None:
        known = read_pattern(arguments.pattern)
    elif known is None or arguments.period is not None:
        known = CfaPattern.bayer(_PERIOD if arguments.period is None else arguments.period)
    origin = getattr(arguments, "origin", None)
    return known if origin is None else replace(known, origin=tuple(origin))


def camera_of(arguments: argparse.Namespace, known: CfaPattern | None = None) -> tuple[Camera | None, CfaPattern]:
    """The camera in the --camera file (None without that option) and the pattern, see `pattern_of`.

    known: the pattern that a connected camera says it has.

    Raises InputError that names the file when the camera was measured with another pattern.
    """
    camera = read_camera(arguments.camera) if arguments.camera else None
    pattern = pattern_of(arguments, known or (camera.pattern if camera else None))
    try:
        if camera:
            camera.check_pattern(pattern)
    except InputError as error:
        raise InputError(f"{arguments.camera}: {error}") from None
    return camera, pattern


def uses_scheduler(arguments: argparse.Namespace) -> bool:
    """Whether a dask scheduler distributes the work. Raises InputError when both options are given, and when one is empty."""
    if "" in (arguments.scheduler, arguments.scheduler_file):  # an unset variable of a shell, and no wish to work here
        raise InputError("--scheduler is empty; give tcp://HOST:PORT, or --scheduler-file FILE")
    if arguments.scheduler and arguments.scheduler_file:
        raise InputError("--scheduler and --scheduler-file name the same thing; give one of them")
    return bool(arguments.scheduler or arguments.scheduler_file)
