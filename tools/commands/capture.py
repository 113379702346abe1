"""Save a camera's frames as shots: each becomes a DNG, TIME-COUNTER.dng, with its preview inside;
or one burst of frames.

SOURCE is - (a raw stream on standard input), a folder into which another program puts raw frames,
genicam:ID, a GigE Vision or USB3 Vision camera (genicam: lists them), or builtin:WIDTHxHEIGHT@FPS,
a simulated sensor that looks at a moving scene. For example:
rpicam-raw -t 0 -n --mode 4056:3040:12:P -o - | panchroma capture - -o shots --size 4056x3040
--pixel-format SRGGB12_CSI2P --stride 6112. The first frames are compared with these options.

If frames come faster than they can be written, whole frames are dropped and counted; those of a
folder or a recording wait.
--burst N keeps N frames in memory as fast as they come, then saves them as TIME-COUNTER-1.dng,
-2.dng ..., and ends; if fewer come, or one cannot be written, none is saved. A stream that loses
bytes on its way ends the command with exit code 1. SIGINT and SIGTERM end it after the current file
(exit codes 130 and 0).
"""

import argparse
import resource
from contextlib import closing
from itertools import islice
from pathlib import Path

from ...device.capture import Refused, capture, capture_burst
from ...device.capture.frame_queue import FrameQueue
from ...device.capture.shots import ShotFolder
from ...shared.errors import InputError, OutputError
from ..batch.console import Console
from ..batch.jobs import FAILED, output_folder
from ..batch.memory import allowed_memory, format_bytes
from ..batch.signals import Stopping
from ..capture.frame_source import FrameSource, doubts, preview_maker
from .frame_options import add_source, source_of
from .options import add, count

_OTHER_FILES = 64  # that a command has open beside those of a burst
# frames that may wait: one covers a slow write, a second a pause of the disk; more would only be
# older
_DEPTH = 2

USAGE = "SOURCE -o DIR"
EXAMPLE = "panchroma capture builtin:1200x800@10 -o shots --frames 20"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma capture`."""
    add_source(parser)
    add(parser, "output", help="folder for the shots, created if missing")
    shots = "stop after N shots (default: when the stream ends)"
    parser.add_argument("--frames", metavar="N", type=count, help=shots)
    burst = "save one burst of N frames, all or none, and stop"
    parser.add_argument("--burst", metavar="N", type=count, help=burst)
    add(parser, "json")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Save frames until the source ends or the user does; returns the exit code."""
    if arguments.burst and arguments.frames:
        raise InputError("--frames does not go with --burst: it counts single shots")
    source, burst = source_of(arguments), arguments.burst
    if burst:
        _check_limits(burst, source)
    shots = ShotFolder(output_folder(arguments.output))
    to = source.sensor, preview_maker(source.sensor), shots
    console.note(*source.notes)
    saved = failed = 0
    doubtful: Path | None = None

    def refused(reason: object) -> None:
        nonlocal failed
        failed += 1
        console.error(str(reason))
        console.record(source=arguments.source, ok=False, error=str(reason))

    with closing(source), Stopping() as stopping:
        # all frames of a burst may wait: none is dropped, and no more are read
        frames = islice(source.frames(stopping, refused, console.note), burst)
        queue = FrameQueue(frames, burst or _DEPTH, wait=source.waits, stopped=stopping)
        try:
            for shot in capture_burst(queue, burst, *to) if burst else capture(queue, *to):
                if isinstance(shot, Refused):
                    if burst and stopping():  # the user has ended it
                        console.note(shot.reason)
                    else:
                        refused(shot.reason)
                    continue
                saved += 1
                if shot.is_checked or not doubtful:
                    doubtful = shot.path
                preview, write = shot.preview * 1e3, shot.write * 1e3
                dropped = source.lost() + queue.dropped
                times = f"preview {preview:.0f} ms, write {write:.0f} ms"
                console.say(f"{shot.path}: {times}, dropped {dropped}")
                facts = {"preview_ms": round(preview, 1), "write_ms": round(write, 1)}
                facts["dropped"] = dropped
                console.record(source=arguments.source, ok=True, output=str(shot.path), **facts)
                if saved == arguments.frames or (stopping() and not burst):
                    break
            else:
                if arguments.frames and not stopping():
                    refused(f"{arguments.source}: ended after {saved} of {arguments.frames} shots")
        except (InputError, OutputError) as error:
            refused(error)  # the stream broke off, or the disk is full: saved shots stay good
            console.note(*doubts(doubtful, error))
        # Frames that still wait at the end are lost too, unless --frames shots were all that was
        # wanted.
        lost = source.lost() + queue.dropped + (len(queue) if stopping() else 0)
    console.note(f"{saved} saved, {lost} dropped" + (f", {failed} failed" if failed else ""))
    return stopping.code or (FAILED if failed else 0)


def _check_limits(frames: int, source: FrameSource) -> None:
    """Raise InputError unless that many frames, as bytes of the camera or as samples, fit into most
    of the free memory.

    All files of a burst are open until the last is written: the system has a limit for these, too.
    """
    layout = source.sensor.layout
    needed = (frames + 1) * max(layout.frame_bytes, 2 * layout.width * layout.height)
    free = allowed_memory(None)
    if needed > free:
        many = f"that many frames of {layout.width} x {layout.height}"
        memory = f"{format_bytes(needed)} of memory, {format_bytes(free)} can be used"
        raise InputError(f"--burst is {frames}: {many} need {memory}; take fewer")
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if limit != resource.RLIM_INFINITY and frames + _OTHER_FILES > limit:
        files = f"--burst is {frames}, and a program may open {limit} files here"
        raise InputError(f"{files}; take fewer, or allow more: ulimit -n {frames + _OTHER_FILES}")
