"""The options of `capture` and `view` that describe the frames of a camera."""

import argparse
from dataclasses import fields
from typing import Any

from shared import Camera, CfaPattern
from shared.errors import InputError
from tools.batch.console import to_stdout
from tools.batch.signals import starting_service
from tools.capture.genicam import GENICAM, connected
from tools.capture.source import PIXEL_FORMATS, FrameSource, SourceOptions, open_source

from .options import add, amount, camera_of, factor

LAYOUT = ("width", "height", "pixel_format", "stride")
"""Arguments that `add_layout` adds."""


class _Source(argparse.Action):
    """Stores SOURCE; for `genicam:` alone the cameras are listed, and nothing else is asked for, as with --help."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: Any = None) -> None:
        if values == GENICAM:
            to_stdout(*(connected() or ["no camera answers: is it plugged in, and has it an address in this machine's network?"]))
            parser.exit()
        setattr(namespace, self.dest, values)


def add_source(parser: argparse.ArgumentParser) -> None:
    """Add SOURCE and the options that describe its frames and its sensor."""
    sources = (
        "- (standard input), a folder that is watched for frames, genicam:ID (a connected camera; genicam: lists them), or "
        "builtin:WIDTHxHEIGHT@FPS"
    )
    parser.add_argument("source", metavar="SOURCE", help=sources, action=_Source)
    frames = add_layout(parser, "the frames of a stream or folder (rpicam-raw prints all this when it starts)")
    add(frames, "sensor-bits")
    black = (
        "black level of the sensor, code (default: the camera's, or a sixteenth of the range); its data sheet says it, "
        "`calibrate --dark` measures it"
    )
    frames.add_argument("--black", metavar="N", type=int, help=black)
    covered = "the lens is covered: frames for `calibrate --dark`, to which the checks that take light are not applied"
    frames.add_argument("--covered", action="store_true", help=covered)
    unchecked = "do not compare the first frames with these options; without it, frames that prove one of them wrong are refused"
    frames.add_argument("--unchecked", action="store_true", help=unchecked)
    frames.add_argument("--new", action="store_true", help="skip frames that are in the folder already")
    camera = parser.add_argument_group("the camera (`panchroma identify` finds pattern and origin in one raw frame)")
    add(camera, "camera", "pattern")
    camera.add_argument("--origin", metavar=("ROW", "COLUMN"), nargs=2, type=int, help="position of the first block (default: 0 0)")
    settings = parser.add_argument_group(
        "settings of a genicam: camera (it says size and stride itself, and the pattern unless its format is Mono)"
    )
    exposure = "such as 1/100 or 0.01 (default: as it is set)"
    settings.add_argument("--exposure-time", metavar="SECONDS", type=factor, help=exposure)
    settings.add_argument("--gain", metavar="N", type=float, help="in the camera's unit, mostly dB (default: as it is set)")
    settings.add_argument("--fps", metavar="N", type=amount, help="frames a second (default: as it is set)")


def add_layout(parser: argparse.ArgumentParser, title: str) -> argparse._ArgumentGroup:
    """Add the options that `layout_of` reads, in a group with this title, which is returned."""
    frames = parser.add_argument_group(title)
    frames.add_argument("--width", metavar="PIXELS", type=int, help="width of a frame")
    frames.add_argument("--height", metavar="PIXELS", type=int, help="height of a frame")
    formats = f"{', '.join(PIXEL_FORMATS)}, or its name in V4L2, libcamera or GenICam: SRGGB10_CSI2P, pRCC, Y12P, Mono12p ..."
    frames.add_argument("--pixel-format", metavar="NAME", help=formats)
    stride = "bytes from one line to the next (default: no padding)"
    frames.add_argument("--stride", metavar="BYTES", type=int, default=0, help=stride)
    return frames


def source_of(arguments: argparse.Namespace) -> FrameSource:
    """The source that these options describe. Raises InputError if there is none."""
    given = SourceOptions(**{each.name: getattr(arguments, each.name) for each in fields(SourceOptions)})
    with starting_service():
        return open_source(given, lambda known: _described(arguments, known))


def _described(arguments: argparse.Namespace, known: CfaPattern | None) -> tuple[Camera | None, CfaPattern]:
    """Return the camera and the pattern. known: that which the camera itself states."""
    if arguments.pattern == "auto":
        raise InputError("--pattern takes a name or letters; `panchroma identify` finds those of one raw frame")
    return camera_of(arguments, known)
