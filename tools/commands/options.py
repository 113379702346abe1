"""The options that several commands share, and the kinds of values that options take."""

import argparse
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from ...shared import Camera, CfaPattern, read_camera
from ...shared.calibration import BITS
from ...shared.errors import InputError
from ...shared.reading import MAX_PIXELS
from ...shared.tiles import TILES
from ..batch.memory import parse_bytes
from ..simulation.noise import PROTOCOLS, Protocol, chosen_protocol
from ..simulation.pattern_text import read_pattern

T = TypeVar("T")


def value(convert: Callable[[str], T], expected: str, fits: Callable[[T], bool] = lambda _: True) -> Callable[[str], T]:
    """Return the type of an option: `convert` of its text, or a usage error with what was expected.

    It is an error if `convert` raises ValueError or ZeroDivisionError, or if its result does not fit.
    """

    def typed(text: str) -> T:
        try:
            if fits(result := convert(text)):
                return result
        except (ValueError, ZeroDivisionError):
            pass
        raise argparse.ArgumentTypeError(f"{text!r} is not {expected}")

    return typed


def numbers(count: int | None = None, example: str = "1,-0.5") -> Callable[[str], tuple[float, ...]]:
    """Return the type of an option that takes numbers with commas between them, `count` of them or any number."""
    expected = f"{count or 'a list of'} numbers with commas between them, such as {example}"
    return value(lambda text: tuple(map(_fraction, text.split(","))), expected, lambda result: count in (None, len(result)))


def _fraction(text: str) -> float:
    number, slash, divisor = text.partition("/")
    return float(number) / float(divisor if slash else 1)


def names(text: str) -> list[str]:
    """The type of an option that takes names with commas between them."""
    return [name.strip() for name in text.split(",") if name.strip()]


def _place(text: str) -> tuple[int, int]:
    row, column = text.split(",")
    return int(row), int(column)


count = value(int, "a whole number from 1 on", lambda number: number >= 1)
natural = value(int, "a whole number from 0 on", lambda number: number >= 0)
amount = value(float, "a number from 0 on", lambda number: 0 <= number < float("inf"))
factor = value(_fraction, "a number, or a fraction such as 1/4")
file_name = value(str, "the name of a file", bool)  # an empty variable of a shell


def text(argument: str) -> str:
    """The text of an argument, which is UTF-8 even where the locale has another encoding, or none (LC_ALL=C)."""
    return os.fsencode(argument).decode("utf-8", "replace")


_SWITCH = {"action": "store_true"}
_SHARED: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "output": (("-o", "--output"), {"metavar": "DIR", "required": True}),
    "resume": (("--resume",), {**_SWITCH, "help": "keep results that are up to date, replace outdated ones"}),
    "overwrite": (("--overwrite",), {**_SWITCH, "help": "replace results that exist already"}),
    "dry-run": (("-n", "--dry-run"), {**_SWITCH, "help": "write nothing, only say what would be done"}),
    "json": (("--json",), {**_SWITCH, "help": "print one JSON object per result to stdout"}),
    "camera": (("--camera",), {"metavar": "FILE", "type": file_name, "help": "camera.json: the calibration of the sensor"}),
    "pattern": (
        ("--pattern",),
        {
            "metavar": "PATTERN",
            "help": "the filters of the sensor: K=4 (the paper's Bayer block in 4 x 4 pixels), a name "
            f"({', '.join(map(str.casefold, TILES))}), the letters of a tile, row by row, W is panchromatic (WBWG/BWGW/WGWR/GWRW), "
            "or a file with them, one row on each line (default: K=6, or the camera's)",
        },
    ),
    "origin": (
        ("--origin",),
        {
            "metavar": "ROW,COLUMN",
            "type": value(_place, "a row and a column, such as 2,3"),
            "help": "position of the first block (default: 0,0)",
        },
    ),
    "sensor-bits": (
        ("--bits",),
        {"metavar": "N", "dest": "sensor_bits", "type": int, "help": f"bits that the sensor delivers, {BITS[0]} to {BITS[-1]}"},
    ),
    "linear": (("--linear",), {**_SWITCH, "help": "take the values of pictures as linear light, whatever the files say"}),
    "seed": (("--seed",), {"metavar": "N", "type": natural, "default": 0, "help": "seed of the noise (default: 0)"}),
    "quality": (("--quality",), {"metavar": "N", "type": int, "help": "quality of a JPEG, 1 (small) to 100 (default: 95)"}),
    "scale": (
        ("--scale",),
        {"metavar": "N", "type": int, "help": "sensor pixels per picture pixel, in each direction; must divide the period"},
    ),
    "latest": (("--latest",), {"metavar": "LINK", "type": Path, "help": "keep a symbolic link with this name to the latest shot"}),
    "jobs": (("-j", "--jobs"), {"metavar": "N", "type": count, "help": "processes at a time"}),
    "max-memory": (
        ("--max-memory",),
        {
            "metavar": "SIZE",
            "type": value(parse_bytes, "a size such as 800M or 4G"),
            "help": "memory for all processes together, for example 4G (default: most of the free memory)",
        },
    ),
    "scheduler": (
        ("--scheduler",),
        {"metavar": "ADDRESS", "type": file_name, "help": "do the work on the workers of this dask scheduler, tcp://HOST:PORT"},
    ),
}


def add(group: argparse._ActionsContainer, *options: str, **changed: Any) -> None:
    """Add shared options, in this order. changed: settings of `add_argument` that differ from the shared ones."""
    for name in options:
        flags, settings = _SHARED[name]
        group.add_argument(*flags, **settings | changed)


def add_noise(parser: argparse._ActionsContainer, **changed: Any) -> None:
    """Add the two options that say which noise is meant, --sigma and --light; `protocol_of` reads them."""
    for each in PROTOCOLS:
        settings: dict[str, Any] = {"metavar": each.metavar, "type": factor, "help": each.help}
        parser.add_argument(f"--{each.option}", **settings | changed)


def add_shots(parser: argparse.ArgumentParser, also: str = "") -> None:
    """Add SHOT, one or more."""
    shots = f"a DNG written by Panchroma, {also}or a folder with DNGs in it or below"
    parser.add_argument("shots", metavar="SHOT", nargs="+", help=shots)


def pixel_limit() -> int:
    """Largest number of pixels of a file that is read: the environment variable PANCHROMA_MAX_PIXELS, or the usual limit."""
    stated = os.environ.get("PANCHROMA_MAX_PIXELS", str(MAX_PIXELS))
    if not stated.isascii() or not stated.isdigit():
        raise InputError(f"the environment variable PANCHROMA_MAX_PIXELS is {stated!r}, expected a number of pixels")
    return int(stated)


def protocol_of(arguments: argparse.Namespace) -> tuple[type[Protocol], Any]:
    """The kind of noise, and its level or levels, None without. Raises InputError for --sigma together with --light."""
    return chosen_protocol({each.option: getattr(arguments, each.option) for each in PROTOCOLS})


def camera_of(arguments: argparse.Namespace, stated: CfaPattern | None = None) -> tuple[Camera | None, CfaPattern]:
    """The camera in the --camera file (None without that option) and the pattern of --pattern, at --origin.

    stated: the pattern that a connected camera says it has. Without it and without --pattern the pattern is that of the camera
        file, or K=6.

    Raises InputError that names the file when the camera was measured with another pattern.
    """
    camera = read_camera(arguments.camera) if arguments.camera else None
    if arguments.pattern is not None:
        pattern = read_pattern(arguments.pattern)
    else:
        pattern = stated or (camera and camera.pattern) or CfaPattern.bayer()
    origin = getattr(arguments, "origin", None)
    if origin is not None:
        pattern = replace(pattern, origin=tuple(origin))
    try:
        if camera:
            camera.check_pattern(pattern)
    except InputError as error:
        raise InputError(f"{arguments.camera}: {error}") from None
    return camera, pattern
