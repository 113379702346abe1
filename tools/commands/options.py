"""The options that several commands share, the kinds of values that options take, and what the
options of a run or of its pictures describe.
"""

import argparse
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from ...shared import Camera, CfaPattern, InputError, read_camera
from ...shared.calibration import BITS
from ...shared.reading import MAX_PIXELS
from ...shared.tiles import TILES
from ..batch.chosen_white import WhiteBalance
from ..batch.jobs import output_folder
from ..batch.journal import key
from ..batch.memory import parse_bytes
from ..batch.order import Run
from ..io.formats import FORMATS, OTHER_NAMES
from ..io.kind import PictureKind
from ..io.versions import program_version
from ..simulation.pattern_text import camera_and_pattern

T = TypeVar("T")


def value(
    convert: Callable[[str], T], expected: str, fits: Callable[[T], object] = lambda _: True
) -> Callable[[str], T]:
    """Return the type of an option: `convert` of its text, or a usage error with what was expected.

    It is an error if `convert` raises ValueError or ZeroDivisionError, or if its result does not
    fit.
    """

    def typed(text: str) -> T:
        with suppress(ValueError, ZeroDivisionError):
            if fits(result := convert(text)):
                return result
        raise argparse.ArgumentTypeError(f"{text!r} is not {expected}")

    return typed


def numbers(number: int = 0, example: str = "1,-0.5") -> Callable[[str], tuple[float, ...]]:
    """Return the type of an option that takes numbers with commas between them, `number` of them; 0
    = any number.
    """

    def convert(text: str) -> tuple[float, ...]:
        return tuple(map(_fraction, text.split(",")))

    expected = f"{number or 'a list of'} numbers with commas between them, such as {example}"
    return value(convert, expected, lambda result: number in (0, len(result)))


def _fraction(text: str) -> float:
    number, slash, divisor = text.partition("/")
    return float(number) / float(divisor if slash else 1)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _row_and_column(text: str) -> tuple[int, int]:
    row, column = text.split(",")
    return int(row), int(column)


count = value(int, "a whole number from 1 on", lambda number: number >= 1)
natural = value(int, "a whole number from 0 on", lambda number: number >= 0)
amount = value(_fraction, "a number from 0 on", lambda number: 0 <= number < float("inf"))
factor = value(_fraction, "a number, or a fraction such as 1/4")
names = value(_names, "a name, or several with commas between them", bool)
file_name = value(str, "the name of a file", bool)  # an empty variable of a shell
letters = value(str, "letters such as RGB", str.isalpha)
_origin = value(_row_and_column, "a row and a column, such as 2,3")
_size = value(parse_bytes, "a size such as 800M or 4G")


def text(argument: str) -> str:
    """The text of an argument, which is UTF-8 even where the locale has another encoding, or none
    (LC_ALL=C).
    """
    return os.fsencode(argument).decode("utf-8", "replace")


_CHOSEN = "resume", "overwrite", "dry_run"
_SAID = "json", "quiet", "verbose"
_OF_A_RUN = {*_CHOSEN, *_SAID, "output", "jobs", "scenes", "shots", "export", "truth"}
Option = tuple[list[str], dict[str, Any]]
"""Names of an option, and the settings of `add_argument`."""


def _option(names: str, metavar: str, about: str | None = None, **settings: Any) -> Option:
    return names.split(), {"metavar": metavar, "help": about, **settings}


def _switch(names: str, about: str) -> Option:
    return names.split(), {"action": "store_true", "help": about}


TILE_NAMES = ", ".join(map(str.casefold, TILES))
_NAMED = f"K=4 (the paper's Bayer block in 4 x 4 pixels), a name ({TILE_NAMES})"
_LETTERS = "the letters of a tile, row by row, W is panchromatic (WBWG/BWGW/WGWR/GWRW)"
_IN_FILE = "a file with them, one row on each line (default: K=6, or the camera's)"
_PATTERN = f"the filters of the sensor: {_NAMED}, {_LETTERS}, or {_IN_FILE}"
_CAMERA = "camera.json: the calibration of the sensor"
_RECALIBRATED = f"{_CAMERA}, in place of the one in the shots"
_DERIVED = "one of which may have no filter: it is what W sees beyond the others"
_USUAL = "RGB where the filters are two of these"
_CHANNELS = f"letters of the channels of the picture, {_DERIVED} (default: {_USUAL})"
_ORIGIN = "position of the first block (default: 0,0)"
_SIGMA = "additive Gaussian noise: its standard deviation, scene units"
_LIGHT = "shot and read noise: amount of light, 1 is a full exposure, 2 is one stop more"
_LINEAR = "take the values of pictures as linear light, whatever the files say"
_QUALITY = "quality of a JPEG, 1 (small) to 100 (default: 95)"
SCALE = "sensor pixels per picture pixel, in each direction; must divide the period"
_MEMORY = "memory for all processes together, for example 4G (default: most of the free memory)"
SENSOR_BITS = f"bits that the sensor delivers, {BITS[0]} to {BITS[-1]}"
_SHARED = {
    "output": _option("-o --output", "DIR", required=True),
    "resume": _switch("--resume", "keep results that are up to date, replace outdated ones"),
    "overwrite": _switch("--overwrite", "replace results that exist already"),
    "dry-run": _switch("-n --dry-run", "write nothing, only say what would be done"),
    "json": _switch("--json", "print one JSON object per result to stdout"),
    "camera": _option("--camera", "FILE", _CAMERA, type=file_name),
    "recalibrate": _option("--camera", "FILE", _RECALIBRATED, type=file_name),
    "pattern": _option("--pattern", "PATTERN", _PATTERN),
    "channels": _option("--channels", "LETTERS", _CHANNELS, type=letters),
    "origin": _option("--origin", "ROW,COLUMN", _ORIGIN, type=_origin),
    "sensor-bits": _option("--sensor-bits", "N", SENSOR_BITS, type=int),
    "sigma": _option("--sigma", "S", _SIGMA, type=factor),
    "light": _option("--light", "FACTOR", _LIGHT, type=factor),
    "linear": _switch("--linear", _LINEAR),
    "seed": _option("--seed", "N", "seed of the noise (default: 0)", type=natural, default=0),
    "quality": _option("--quality", "N", _QUALITY, type=int),
    "scale": _option("--scale", "N", SCALE, type=int),
    "jobs": _option("-j --jobs", "N", "processes at a time", type=count),
    "max-memory": _option("--max-memory", "SIZE", _MEMORY, type=_size),
}


def add(group: argparse._ActionsContainer, *options: str, **changed: Any) -> None:
    """Add shared options, in this order.

    changed: settings of `add_argument` that differ from the shared ones.
    """
    for option in options:
        names, settings = _SHARED[option]
        group.add_argument(*names, **settings | changed)


def add_shots(parser: argparse.ArgumentParser, also: str = "") -> None:
    """Add SHOT, one or more."""
    shots = f"a DNG written by Panchroma, {also}or a folder with DNGs in it or below"
    parser.add_argument("shots", metavar="SHOT", nargs="+", help=shots)


def add_file_run(parser: argparse.ArgumentParser, what: str) -> None:
    """Add the options of `file_run`, and --jobs. what: is done several at a time."""
    add(parser, "resume", "overwrite", "dry-run")
    add(parser, "jobs", default=1, help=f"{what} at a time (default: 1)")


def file_run(arguments: argparse.Namespace, folder: Path, **read: object) -> Run:
    """The run that the options describe. read: what is in the files that they name."""
    of_files = {name: value for name, value in vars(arguments).items() if name not in _OF_A_RUN}
    made_by = key(program=program_version(), **of_files | read)
    chosen = {name: getattr(arguments, name) for name in _CHOSEN}
    return Run(folder=folder, made_by=made_by, **chosen)


def pixel_limit() -> int:
    """Largest number of pixels of a file that is read: the environment variable
    PANCHROMA_MAX_PIXELS, or the usual limit.
    """
    stated = os.environ.get("PANCHROMA_MAX_PIXELS", str(MAX_PIXELS))
    if not stated.isascii() or not stated.isdigit():
        variable = "the environment variable PANCHROMA_MAX_PIXELS"
        raise InputError(f"{variable} is {stated!r}, expected a number of pixels")
    return int(stated)


def camera_of(
    arguments: argparse.Namespace, stated: CfaPattern | None = None
) -> tuple[Camera | None, CfaPattern]:
    """The camera in the --camera file (None without that option) and the pattern of --pattern with
    --channels, at --origin.

    stated: see `camera_and_pattern`.
    """
    filters = arguments.pattern, arguments.channels, arguments.origin
    return camera_and_pattern(arguments.camera, *filters, stated)


def add_pictures(parser: argparse.ArgumentParser, *presets: str) -> argparse._ArgumentGroup:
    """Add the options of pictures, from --format to --preset, the first of which is the default,
    and those of their run, whose group is returned.
    """
    kinds = FORMATS.values()
    words = [", ".join(FORMATS)]
    words += [f"{alias} is {name}" for alias, name in OTHER_NAMES.items()]
    words += [f"{kind.name}: {kind.about}" for kind in kinds if kind.about]
    group = parser.add_argument_group("the picture")
    chosen: dict[str, Any] = {"choices": tuple(FORMATS), "default": "tif", "type": _format}
    formats = f"{'; '.join(words)} (default: tif)"
    group.add_argument("-f", "--format", metavar="FORMAT", **chosen, help=formats)
    bits = "bits per sample (default: the usual ones of the format)"
    group.add_argument("--bits", type=int, choices=(8, 16, 32), help=bits)
    lossy = ", ".join(kind.name for kind in kinds if kind.has_quality)
    quality = f"for {lossy}: 1 (small) to 100 (default: 95; of jxl 100, without loss)"
    add(group, "quality", help=quality)
    spaces = tuple(dict.fromkeys(space for kind in kinds for space in kind.spaces))
    space = "colour space; camera: scene units (default: the usual one of the format)"
    group.add_argument("--space", choices=spaces, help=space)
    darker = "negative ones darken it, and what is clipped stays white"
    exposure = f"brighten the picture by this many stops; {darker} (default: 0)"
    group.add_argument("--exposure", metavar="STOPS", type=factor, default=0.0, help=exposure)
    known = "camera (as shot, the default), auto (estimated from the picture)"
    grey = "the 9 x 9 pixels around it are grey; of a burst in --reference, or the first shot"
    balance = f"white balance: {known}, X,Y ({grey}), or multipliers such as 2.1,1,1.6"
    group.add_argument("--wb", metavar="BALANCE", type=_balance, default="camera", help=balance)
    add(group, "recalibrate")
    published = "; paper: the published method, literally" if "paper" in presets else ""
    unlearned = "without the networks that correct luminance and colour"
    preset = f"best (the default); unlearned: {unlearned}{published}"
    group.add_argument("--preset", choices=presets, default=presets[0], help=preset)
    group = parser.add_argument_group("the run")
    add(group, "resume", "overwrite", "dry-run", "max-memory")
    return group


def _balance(text: str) -> str | tuple[float, ...]:
    return numbers()(text) if "," in text else text


def _format(name: str) -> str:
    """The key of a format, however a user writes it: PNG, .png, tiff."""
    key = name.casefold().removeprefix(".")
    return OTHER_NAMES.get(key, key)


def order_fields(arguments: argparse.Namespace) -> dict[str, Any]:
    """The fields of an `Order` that these options set; creates the output folder.

    Raises InputError: and OutputError.
    """
    kind = PictureKind.of(arguments.format, arguments.bits, arguments.space, arguments.quality)
    kind.check_exposure(arguments.exposure)
    white = WhiteBalance.parse(arguments.wb)
    white.check(kind)
    fields = {name: getattr(arguments, name) for name in ("preset", "exposure", *_CHOSEN)}
    fields |= {"kind": kind, "white": white, "max_pixels": pixel_limit()}
    fields["camera"] = read_camera(arguments.camera) if arguments.camera else None
    return fields | {"folder": output_folder(arguments.output, dry_run=arguments.dry_run)}
