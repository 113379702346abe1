"""The options of `capture` and `view` that describe the frames of a camera."""

import argparse
import signal
from dataclasses import fields
from functools import partial
from typing import Any

from ..batch.console import to_stdout
from ..batch.signals import Terminated
from ..capture.frame_source import PIXEL_FORMATS, FrameSource, SourceOptions, open_source
from ..capture.genicam import GENICAM, connected
from .options import add, amount, camera_of, factor, value


def _width_and_height(text: str) -> tuple[int, int]:
    width, height = text.casefold().split("x")
    return int(width), int(height)


_size = value(_width_and_height, "a width and a height, such as 4056x3040")


class _Source(argparse.Action):
    """Stores SOURCE; for `genicam:` alone the cameras are listed, and nothing else is asked for, as
    with --help.
    """

    def __call__(self, parser: Any, namespace: Any, values: Any, option: Any = None) -> None:
        if values == GENICAM:
            advice = "is it plugged in, and has it an address in this machine's network?"
            to_stdout(*(connected() or [f"no camera answers: {advice}"]))
            parser.exit()
        setattr(namespace, self.dest, values)


def add_source(parser: argparse.ArgumentParser) -> None:
    """Add SOURCE and the options that describe its frames and its sensor."""
    cameras = "genicam:ID (a connected camera; genicam: lists them), or builtin:WIDTHxHEIGHT@FPS"
    sources = f"- (standard input), a folder that is watched for frames, {cameras}"
    parser.add_argument("source", metavar="SOURCE", help=sources, action=_Source)
    title = "the frames of a stream or folder (rpicam-raw prints all this when it starts)"
    frames = add_layout(parser, title)
    add(frames, "sensor-bits")
    known = "its data sheet says it, `calibrate --dark` measures it"
    usual = "the camera's, or a sixteenth of the range"
    black = f"black level of the sensor, code (default: {usual}); {known}"
    frames.add_argument("--black", metavar="N", type=int, help=black)
    wrong = "without it, frames that prove one of them wrong are refused"
    compared = "the first frames with these options, as with a covered lens"
    unchecked = f"do not compare {compared}; {wrong}"
    frames.add_argument("--unchecked", action="store_true", help=unchecked)
    new = "skip frames that are in the folder already"
    frames.add_argument("--new", action="store_true", help=new)
    title = "the camera (`panchroma identify` finds pattern and origin in one raw frame)"
    add(parser.add_argument_group(title), "camera", "pattern", "channels", "origin")
    itself = "it says size and stride itself, and the pattern unless its format is Mono"
    settings = parser.add_argument_group(f"settings of a genicam: camera ({itself})")
    exposure = "such as 1/100 or 0.01 (default: as it is set)"
    settings.add_argument("--exposure-time", metavar="SECONDS", type=factor, help=exposure)
    gain = "in the camera's unit, mostly dB (default: as it is set)"
    settings.add_argument("--gain", metavar="N", type=factor, help=gain)
    rate = "frames a second (default: as it is set)"
    settings.add_argument("--fps", metavar="N", type=amount, help=rate)


def add_layout(parser: argparse.ArgumentParser, title: str) -> argparse._ArgumentGroup:
    """Add the options that `layout_of` reads, in a group with this title, which is returned."""
    frames = parser.add_argument_group(title)
    size = "width and height of a frame, such as 4056x3040"
    frames.add_argument("--size", metavar="WxH", type=_size, default=(None, None), help=size)
    names = "SRGGB10_CSI2P, pRCC, Y12P, Mono12p ..."
    formats = f"{', '.join(PIXEL_FORMATS)}, or its name in V4L2, libcamera or GenICam: {names}"
    frames.add_argument("--pixel-format", metavar="NAME", help=formats)
    stride = "bytes from one line to the next (default: no padding)"
    frames.add_argument("--stride", metavar="BYTES", type=int, default=0, help=stride)
    return frames


def options_of(arguments: argparse.Namespace, source: str) -> SourceOptions:
    """Return the description of a source, as far as the options of a command set its fields."""
    settings = {**vars(arguments), "width": arguments.size[0], "height": arguments.size[1]}
    names = {field.name for field in fields(SourceOptions)[1:]} & settings.keys()
    return SourceOptions(source, **{name: settings[name] for name in names})


def source_of(arguments: argparse.Namespace) -> FrameSource:
    """The source that these options describe.

    Raises InputError if there is none.
    """
    try:
        return open_source(options_of(arguments, arguments.source), partial(camera_of, arguments))
    except Terminated as ended:  # the usual way to stop a service, which has no frame yet
        if ended.code == 128 + signal.SIGTERM:
            raise SystemExit(0) from None
        raise
