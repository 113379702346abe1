"""Options that several commands have, and the checks that belong to them."""

import argparse
import os
import re
from dataclasses import replace
from typing import Any

from shared import Camera, CfaPattern, read_camera
from shared.errors import InputError
from shared.pattern import BAYER_ORDERS, PERIODS
from shared.reading import MAX_PIXELS, read_text
from shared.spelling import meant
from shared.tiles import EXPECTED, TILES, letters_of

_PERIOD, _ORDER, _ORIGIN = 6, "RGGB", (0, 0)
_LETTERS = re.compile("[A-Z/]+")
_MOST_LETTERS = PERIODS[-1] * (PERIODS[-1] + 1)  # with what parts the rows
_LARGEST_PATTERN = 1 << 16  # bytes of a file, with its comments


def add_camera(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add --camera, --pattern, --period, --order and --origin, for a sensor without shots; return their group.

    `camera_of` reads them.
    """
    group = parser.add_argument_group("the camera")
    group.add_argument("--camera", metavar="FILE", help="camera.json: gamma, noise, levels and colours of a calibrated sensor")
    add_pattern(group)
    group.add_argument("--origin", type=int, nargs=2, metavar=("ROW", "COLUMN"), help="position of the first block (default: 0 0)")
    return group


def add_pattern(group: argparse._ActionsContainer) -> None:
    """Add --pattern, --period and --order; `pattern_of` reads them."""
    periods = f"{PERIODS[0]} to {PERIODS[-1]}"
    group.add_argument(
        "--pattern",
        metavar="LETTERS",
        help="the filters of a tile, row by row, W is panchromatic: WBWG/BWGW/WGWR/GWRW; or its name: "
        f"{', '.join(map(str.casefold, TILES))}; or a file with them, one row on each line",
    )
    group.add_argument("--period", type=int, metavar="K", help=f"pixels from block to block, {periods} (default: {_PERIOD})")
    group.add_argument("--order", choices=BAYER_ORDERS, help=f"colour filters of a block, row by row (default: {_ORDER})")


def names_pattern(arguments: argparse.Namespace) -> bool:
    """Whether one of the options of `add_pattern` is given."""
    return any(getattr(arguments, name) is not None for name in ("pattern", "period", "order"))


def pattern_of(arguments: argparse.Namespace, known: CfaPattern | None = None) -> CfaPattern:
    """The pattern that --pattern, or --period and --order, describe, at --origin; of `known`, the camera's own, what is not given.

    Raises InputError for a period outside the supported range, for what `parsed_pattern` refuses, and for --pattern beside --period
    or --order.
    """
    origin = getattr(arguments, "origin", None)
    if arguments.pattern is not None:
        for option in ("period", "order"):
            if getattr(arguments, option) is not None:
                raise InputError(f"--pattern says where every filter is; leave --{option} out")
        known = parsed_pattern(arguments.pattern)
    elif known is None or names_pattern(arguments):
        period = _PERIOD if arguments.period is None else arguments.period
        known = CfaPattern.bayer(period, arguments.order or _ORDER)
    return known if origin is None else replace(known, origin=tuple(origin))


def parsed_pattern(text: str) -> CfaPattern:
    """The pattern that a user writes as letters ("RGWW/GBWW/WWWW/WWWW"), or the name of a file with them.

    text: the name of a tile, see `shared.tiles`; or else that of a file, if there is one; or else the letters. In a file a row ends
        with its line or a "/"; white space, empty lines, and what follows a # are left out.
    Raises InputError that names the file, or --pattern, and says what is wrong with the letters.
    """
    is_file = letters_of(text) is None and os.path.exists(text)  # noqa: PTH110 (Path.exists raises for a name that is too long)
    try:
        letters = _letters_in(text) if is_file else text
        if not is_file and letters_of(text) is None and not _LETTERS.fullmatch(text):
            raise InputError(f"is not {EXPECTED}, and no file has this name{meant(text, TILES)}")
        if len(letters) > _MOST_LETTERS:
            raise InputError(f"{len(letters)} letters are more than the largest tile has, {PERIODS[-1]} x {PERIODS[-1]}")
        return CfaPattern.of_letters(letters)
    except InputError as error:
        said = str(error).removeprefix("pattern: ")
        raise InputError(f"{text}: {said}" if is_file else f"--pattern {text[:_MOST_LETTERS]!r}: {said}") from None


def _letters_in(name: str) -> str:
    """The rows in a file with a pattern, parted by "/"."""
    lines = read_text(name, _LARGEST_PATTERN, "a pattern", otherwise="latin-1").splitlines()
    rows = ["".join(row.split()) for line in lines for row in line.partition("#")[0].split("/")]
    return "/".join(row for row in rows if row)


def camera_of(arguments: argparse.Namespace) -> tuple[Camera | None, CfaPattern]:
    """Return the camera in the --camera file (None without that option) and the pattern, see `pattern_of`.

    Raises InputError that names the file when the camera was measured with another pattern.
    """
    camera = read_camera(arguments.camera) if arguments.camera else None
    pattern = pattern_of(arguments, camera.pattern if camera else None)
    try:
        if camera:
            camera.check_pattern(pattern)
    except InputError as error:
        raise InputError(f"{arguments.camera}: {error}") from None
    return camera, pattern


def add_output_folder(parser: argparse.ArgumentParser, files: str) -> None:
    """Add -o, the folder into which a command writes `files`; `tools.host.jobs.output_folder` creates it."""
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help=f"folder for {files}, created if missing")


def add_calibration(parser: argparse.ArgumentParser) -> None:
    """Add --camera, for commands that read shots."""
    parser.add_argument("--camera", metavar="FILE", help="camera.json to use instead of the calibration in the shots")


def add_graph(group: argparse._ActionsContainer) -> None:
    """Add --graph; `tools.pictures.previews.load_graph` loads it."""
    group.add_argument("--graph", metavar="FILE", help="preview graph from export-preview, for a pattern without a built-in graph")


def add_scale(parser: argparse.ArgumentParser) -> None:
    """Add --scale, for a preview."""
    text = "sensor pixels per picture pixel, in each direction; must divide the period"
    parser.add_argument("--scale", type=int, default=1, metavar="N", help=text)


def add_quality(parser: argparse.ArgumentParser, more: str = "") -> None:
    """Add --quality, for commands that write JPEG; `tools.pictures.encoders.check_quality` checks it."""
    text = f"quality of a JPEG, 1 (small) to 100 (default: 95){more}"
    parser.add_argument("--quality", type=int, metavar="N", help=text)


def add_max_pixels(parser: argparse.ArgumentParser) -> None:
    """Add --max-pixels, for commands that read untrusted files."""
    parser.add_argument(
        "--max-pixels", type=_at_least_one, default=MAX_PIXELS, metavar="N", help="refuse a file with more pixels than this"
    )


def _at_least_one(argument: str) -> int:
    if not argument.isdecimal() or int(argument) < 1:
        raise argparse.ArgumentTypeError(f"{argument!r} is not a whole number from 1 on")
    return int(argument)


def add_overwrite(group: argparse._ActionsContainer) -> None:
    """Add --overwrite."""
    group.add_argument("--overwrite", action="store_true", help="replace results that exist already")


def _factor(argument: str) -> float:
    """A number, or a fraction such as 1/4."""
    number, slash, divisor = argument.partition("/")
    try:
        return float(number) / float(divisor if slash else 1)
    except (ValueError, ZeroDivisionError):
        raise argparse.ArgumentTypeError(f"{argument!r} is neither a number nor a fraction such as 1/4") from None


class _CalledLight(argparse.Action):
    def __call__(self, *_: object) -> None:
        raise InputError("--exposure is called --light here, a factor (2 is one stop more); --exposure, in stops, is for render")


def add_light(group: argparse._ActionsContainer, **described: Any) -> None:
    """Add --light, amounts of light of --protocol sensor; --exposure, its former name, raises InputError that says so."""
    group.add_argument("--light", type=_factor, metavar="FACTOR", **described)
    group.add_argument("--exposure", nargs="?", action=_CalledLight, help=argparse.SUPPRESS)


def add_json(group: argparse._ActionsContainer, each: str) -> None:
    """Add --json, which prints one object per `each`."""
    group.add_argument("--json", action="store_true", help=f"print one JSON object per {each} to stdout")


def add_max_memory(group: argparse._ActionsContainer) -> None:
    """Add --max-memory; `tools.host.memory.allowed_memory` parses it."""
    group.add_argument(
        "--max-memory", metavar="SIZE", help="memory for all processes together, for example 4G (default: most of the free memory)"
    )


def add_preview_threads(parser: argparse.ArgumentParser) -> None:
    """Add -j, for commands that make previews of a stream."""
    parser.add_argument("-j", "--jobs", type=int, metavar="N", help="threads of the preview (default: one per core)")


def add_scheduler(group: argparse._ActionsContainer) -> None:
    """Add --scheduler and --scheduler-file; see `uses_scheduler`."""
    group.add_argument("--scheduler", metavar="ADDRESS", help="do the work on the workers of this dask scheduler, tcp://HOST:PORT")
    group.add_argument("--scheduler-file", metavar="FILE", help="as --scheduler, for the scheduler that wrote this file")


def uses_scheduler(arguments: argparse.Namespace) -> bool:
    """Whether a dask scheduler distributes the work. Raises InputError when both options are given, and when one is empty."""
    if "" in (arguments.scheduler, arguments.scheduler_file):  # an unset variable of a shell, and no wish to work here
        raise InputError("--scheduler is empty; give tcp://HOST:PORT, or --scheduler-file FILE")
    if arguments.scheduler and arguments.scheduler_file:
        raise InputError("--scheduler and --scheduler-file name the same thing; give one of them")
    return bool(arguments.scheduler or arguments.scheduler_file)


def check_at_least_one(arguments: argparse.Namespace, *names: str) -> None:
    """Raise InputError when one of these whole-number options is given and below 1."""
    for name in names:
        number = getattr(arguments, name)
        if number is not None and number < 1:
            option = "-j" if name in ("jobs", "threads") else f"--{name}"
            raise InputError(f"{option} is {number}, expected 1 or more")


def text(argument: str) -> str:
    """The text of an argument, which is UTF-8 even where the locale has another encoding, or none (LC_ALL=C)."""
    return os.fsencode(argument).decode("utf-8", "replace")
