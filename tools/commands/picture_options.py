"""The options that say what rendered pictures are to be like, and the fields of an order that they
set.
"""

import argparse
from secrets import token_hex
from typing import Any

from ...shared import read_camera
from ..batch.chosen_white import WhiteBalance
from ..batch.jobs import output_folder
from ..io.formats import FORMATS, OTHER_NAMES
from ..io.kind import PictureKind
from .options import add, factor, numbers, pixel_limit


def add_picture(parser: argparse.ArgumentParser, *presets: str) -> None:
    """Add the options of a picture, from --format to --preset, the first of which is the
    default.
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


def _balance(text: str) -> str | tuple[float, ...]:
    return numbers()(text) if "," in text else text


def _format(name: str) -> str:
    """The key of a format, however a user writes it: PNG, .png, tiff."""
    key = name.casefold().removeprefix(".")
    return OTHER_NAMES.get(key, key)


def add_run(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the options of a run, and return their group."""
    group = parser.add_argument_group("the run")
    add(group, "resume", "overwrite", "dry-run", "max-memory")
    return group


def order_fields(arguments: argparse.Namespace) -> dict[str, Any]:
    """The fields of an `Order` that these options set; creates the output folder.

    Raises InputError: and OutputError.
    """
    kind = PictureKind.of(arguments.format, arguments.bits, arguments.space, arguments.quality)
    kind.check_exposure(arguments.exposure)
    white = WhiteBalance.parse(arguments.wb)
    white.check(kind)
    as_given = "preset", "exposure", "resume", "overwrite", "dry_run"
    fields = {name: getattr(arguments, name) for name in as_given}
    fields |= {"kind": kind, "white": white, "max_pixels": pixel_limit(), "run": token_hex(8)}
    fields["camera"] = read_camera(arguments.camera) if arguments.camera else None
    return fields | {"folder": output_folder(arguments.output, dry_run=arguments.dry_run)}
