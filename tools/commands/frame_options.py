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

from .options import add, amount, camera_of, factor, option

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
    option(parser, "SOURCE", sources, dest="source", action=_Source)
    frames = add_layout(parser, "the frames of a stream or folder (rpicam-raw prints all this when it starts)")
    add(frames, "sensor-bits", usual="those of the pixel format")
    option(
        frames,
        "--black N",
        "black level of the sensor, code (default: the camera's, or a sixteenth of the range); its data sheet says it, "
        "`calibrate --dark` measures it",
        type=int,
    )
    covered = "the lens is covered: frames for `calibrate --dark`, to which the checks that take light are not applied"
    option(frames, "--covered", covered)
    unchecked = "do not compare the first frames with these options; without it, frames that prove one of them wrong are refused"
    option(frames, "--unchecked", unchecked)
    option(frames, "--new", "skip frames that are in the folder already")
    more = "; `panchroma identify` finds it in one raw frame"
    add(parser.add_argument_group("the camera"), "camera", "pattern", "period", "origin", more=more)
    settings = parser.add_argument_group(
        "settings of a genicam: camera (it says size and stride itself, and the pattern unless its format is Mono)"
    )
    option(settings, "--exposure-time SECONDS", "such as 1/100 or 0.01 (default: as it is set)", type=factor)
    option(settings, "--gain N", "in the camera's unit, mostly dB (default: as it is set)", type=float)
    option(settings, "--fps N", "frames a second (default: as it is set)", type=amount)


def add_layout(parser: argparse.ArgumentParser, title: str) -> argparse._ArgumentGroup:
    """Add the options that `layout_of` reads, in a group with this title, which is returned."""
    frames = parser.add_argument_group(title)
    option(frames, "--width PIXELS", "width of a frame", type=int)
    option(frames, "--height PIXELS", "height of a frame", type=int)
    formats = f"{', '.join(PIXEL_FORMATS)}, or its name in V4L2, libcamera or GenICam: SRGGB10_CSI2P, pRCC, Y12P, Mono12p ..."
    option(frames, "--pixel-format NAME", formats)
    option(frames, "--stride BYTES", "bytes from one line to the next (default: no padding)", type=int, default=0)
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
