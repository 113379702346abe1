"""The options that say what rendered pictures are to be like, and the fields of an order that they set."""

import argparse
import secrets
from typing import Any

from shared import read_camera
from shared.errors import InputError
from tools.batch.defect_list import read_defects
from tools.batch.jobs import output_folder
from tools.batch.white_balance import WhiteBalance
from tools.io.formats import FORMATS, OTHER_NAMES
from tools.io.kind import PictureKind

from .options import add, file_name, option


def add_picture(parser: argparse.ArgumentParser, *presets: str) -> None:
    """Add the options of a picture, from --format to --preset, the first of which is the default, and --max-pixels."""
    option(
        parser,
        "-f --format",
        "; ".join(
            f"{each.name}: {each.about}" if each.about else f"{each.aliases[0]} is {each.name}"
            for each in FORMATS.values()
            if each.about or each.aliases
        ),
        type=_format,
        choices=tuple(FORMATS),
        default="tif",
    )
    option(parser, "--bits", "bits per sample (default: the usual ones of the format)", type=int, choices=(8, 16, 32))
    lossy = [each.name for each in FORMATS.values() if each.has_quality]
    add(parser, "quality", more=f"; for {', '.join(lossy)}")
    spaces = tuple(dict.fromkeys(space for each in FORMATS.values() for space in each.spaces))
    option(parser, "--space", "colour space; camera: scene units (default: the usual one of the format)", choices=spaces)
    exposure = "brighten the picture by this many stops; negative ones darken it, and what is burnt out stays white"
    option(parser, "--exposure STOPS", exposure, type=float, default=0.0)
    balance = "white balance: camera (as shot), auto (estimated from the picture), or multipliers R,G,B, such as 2.1,1,1.6"
    option(parser, "--wb BALANCE", balance, type=WhiteBalance.parse, default="camera")
    add(parser, "camera", instead=", in place of the one in the shots")
    option(parser, "--defects FILE", "more defective pixels: a text, a line of row, column (from 0) for each", type=file_name)
    published = "; paper: the published method, literally" * ("paper" in presets)
    option(
        parser,
        "--preset",
        f"unlearned: best without the networks that correct luminance and colour{published}",
        choices=presets,
        default=presets[0],
    )
    add(parser, "max-pixels")


def _format(name: str) -> str:
    """The key of a format, however a user writes it: PNG, .png, tiff."""
    known = name.casefold().removeprefix(".")
    return OTHER_NAMES.get(known, known)


def add_run(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the options of a run, and return their group."""
    group = parser.add_argument_group("the run")
    add(group, "resume", "overwrite", "dry-run", "threads", "max-memory", of=" of each process")
    return group


def order_fields(arguments: argparse.Namespace) -> dict[str, Any]:
    """The fields of an `Order` that these options set; creates the output folder. Raises InputError and OutputError."""
    if arguments.defects and arguments.preset == "paper":
        raise InputError("--defects needs --preset best: the published method does not know defects")
    kind = PictureKind.of(arguments.format, arguments.bits, arguments.space, arguments.quality)
    kind.check_exposure(arguments.exposure)
    arguments.wb.check(kind)
    asked = ("preset", "exposure", "max_pixels", "resume", "overwrite", "dry_run")
    return {
        **{name: getattr(arguments, name) for name in asked},
        "kind": kind,
        "white": arguments.wb,
        "camera": read_camera(arguments.camera) if arguments.camera else None,
        "defects": read_defects(arguments.defects) if arguments.defects else (),
        "folder": output_folder(arguments.output, dry_run=arguments.dry_run),
        "run": secrets.token_hex(8),
    }
