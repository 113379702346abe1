"""The options of `capture` and `view` that describe the frames of a camera."""

import argparse
from dataclasses import fields

from tools.live.source import PIXEL_FORMATS, FrameSource, SourceOptions, open_source

from .options import add, camera_of

LAYOUT = ("width", "height", "pixel_format", "stride")
"""Arguments that `add_layout` adds."""


def add_source(parser: argparse.ArgumentParser) -> None:
    """Add SOURCE and the options that describe its frames and its sensor."""
    parser.add_argument(
        "source", metavar="SOURCE", help="- (standard input), a folder that is watched for frames, or builtin:WIDTHxHEIGHT@FPS"
    )
    frames = add_layout(parser, "the frames of a stream or folder (rpicam-raw prints all this when it starts)")
    add(frames, "sensor-bits", usual="those of the pixel format")
    frames.add_argument(
        "--black",
        type=int,
        metavar="N",
        help="black level of the sensor, code (default: the camera's, or a sixteenth of the range); its data sheet says it, "
        "`calibrate --dark` measures it",
    )
    frames.add_argument(
        "--covered",
        action="store_true",
        help="the lens is covered: frames for `calibrate --dark`, to which the checks that take light are not applied",
    )
    frames.add_argument(
        "--unchecked",
        action="store_true",
        help="do not compare the first frames with these options; without it, frames that prove one of them wrong are refused",
    )
    frames.add_argument("--new", action="store_true", help="skip frames that are in the folder already")
    add(parser.add_argument_group("the camera"), "camera", "pattern", "period", "origin")


def add_layout(parser: argparse.ArgumentParser, title: str) -> argparse._ArgumentGroup:
    """Add the options that `layout_of` reads, in a group with this title, which is returned."""
    frames = parser.add_argument_group(title)
    frames.add_argument("--width", type=int, metavar="PIXELS", help="width of a frame")
    frames.add_argument("--height", type=int, metavar="PIXELS", help="height of a frame")
    frames.add_argument(
        "--pixel-format",
        metavar="NAME",
        help=f"{', '.join(PIXEL_FORMATS)}, or its name in V4L2 or libcamera, such as SRGGB10_CSI2P, pRCC, RG16 or Y12P",
    )
    frames.add_argument(
        "--stride", type=int, default=0, metavar="BYTES", help="bytes from one line to the next (default: no padding)"
    )
    return frames


def source_of(arguments: argparse.Namespace) -> FrameSource:
    """The source that these options describe. Raises InputError if there is none."""
    given = SourceOptions(**{each.name: getattr(arguments, each.name) for each in fields(SourceOptions)})
    return open_source(given, *camera_of(arguments))
