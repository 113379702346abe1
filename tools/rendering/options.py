"""The options that say what pictures are to be like, and the fields of an order that they set."""

import argparse
import secrets
from typing import Any

from shared import read_camera
from tools.host import options
from tools.host.jobs import output_folder
from tools.pictures.writer import OTHER_NAMES, POSSIBLE, PictureKind, check_gain

from .defect_list import read_defects
from .white_balance import WhiteBalance


def add_picture(parser: argparse.ArgumentParser) -> None:
    """Add the options of a picture, from --format to --defects, and --no-learned and --max-pixels."""
    parser.add_argument(
        "-f",
        "--format",
        type=_format,
        choices=tuple(POSSIBLE),
        default="tif",
        help="tiff and jpeg are other names of tif and jpg; jxl: JPEG XL; uhdr: Ultra HDR, a JPEG with a map of gains for HDR "
        "displays; dng: linear, to finish in a raw developer",
    )
    parser.add_argument("--bits", type=int, choices=(8, 16, 32), help="bits per sample (default: the usual ones of the format)")
    options.add_quality(parser, ", also of uhdr, and of jxl, which is lossless by default")
    spaces = tuple(dict.fromkeys(space for possible in POSSIBLE.values() for space in possible))
    parser.add_argument("--space", choices=spaces, help="colour space; camera: scene units (default: the usual one of the format)")
    parser.add_argument(
        "--exposure",
        type=float,
        default=0.0,
        metavar="STOPS",
        help="brighten the picture by this many stops; negative ones darken it, and what is burnt out stays white",
    )
    parser.add_argument(
        "--wb",
        type=WhiteBalance.parse,
        default="camera",
        metavar="BALANCE",
        help="white balance: camera (as shot), auto (estimated from the picture), or multipliers R,G,B, such as 2.1,1,1.6",
    )
    options.add_calibration(parser)
    parser.add_argument("--defects", metavar="FILE", help="more defective pixels: lines of row, column (from 0), or JSON")
    parser.add_argument("--no-learned", action="store_true", help="do without the network that corrects colour (preset best)")
    options.add_max_pixels(parser)


def _format(name: str) -> str:
    """The key of a format, however a user writes it: PNG, .png, tiff."""
    known = name.casefold().removeprefix(".")
    return OTHER_NAMES.get(known, known)


def add_run(group: argparse._ActionsContainer) -> None:
    """Add --resume, --overwrite and --dry-run."""
    group.add_argument("--resume", action="store_true", help="keep results that are up to date, replace outdated ones")
    group.add_argument("--overwrite", action="store_true", help="replace results that exist already, whoever wrote them")
    group.add_argument("--dry-run", action="store_true", help="write nothing, only say what would be done")


def order_fields(arguments: argparse.Namespace) -> dict[str, Any]:
    """The fields of an `Order` that these options set; creates the output folder. Raises InputError and OutputError."""
    kind = PictureKind.of(arguments.format, arguments.bits, arguments.space, arguments.quality)
    check_gain(kind, arguments.exposure)
    arguments.wb.check(kind)
    return {
        "kind": kind,
        "learned": not arguments.no_learned,
        "exposure": arguments.exposure,
        "white": arguments.wb,
        "camera": read_camera(arguments.camera) if arguments.camera else None,
        "defects": read_defects(arguments.defects) if arguments.defects else (),
        "folder": output_folder(arguments.output, dry_run=arguments.dry_run),
        "max_pixels": arguments.max_pixels,
        "run": secrets.token_hex(8),
        "resume": arguments.resume,
        "overwrite": arguments.overwrite,
        "dry_run": arguments.dry_run,
    }
