"""Show a camera's live picture on a web page, with frame rate, latency and dropped frames, and a button that saves a shot.

SOURCE is as for `panchroma capture`. By default only this machine can open the page; with --bind 0.0.0.0 everybody on the network
can, and with -o they can save shots too. The preview in a shot is the picture that is shown; --scale 1 makes it a full one, and
`panchroma preview` makes one of any shot later. SIGINT and SIGTERM end the command after the current shot (exit codes 130 and 0).
"""

import argparse
import threading

from device.capture.frame_queue import FrameQueue
from device.capture.shots import ShotFolder
from device.preview.geometry import Geometry
from shared import CfaPattern
from shared.errors import InputError
from tools.host.console import Console
from tools.host.jobs import FAILED, output_folder
from tools.host.signals import Stopping
from tools.live.server import ViewfinderServer
from tools.live.showing import show_frames
from tools.live.viewfinder import Viewfinder
from tools.pictures.previews import preview_maker

from .frame_options import add_source, source_of
from .options import add

_WIDEST = 1440  # pixels: a wider picture does not fit a phone or a page, and costs the camera time


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma view`."""
    add_source(parser)
    parser.add_argument("-o", "--output", metavar="DIR", help="folder for shots, created if missing; without it there is no button")
    parser.add_argument("--bind", default="127.0.0.1", metavar="ADDRESS", help="network interface that serves the page")
    parser.add_argument("--port", type=int, default=8000, help="port of the page; 0 takes any free one")
    add(parser, "scale", "latest", "threads", of=" of the preview")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Serve the page until the source ends or the user does; returns the exit code."""
    if arguments.latest and arguments.output is None:
        raise InputError("--latest needs -o DIR: without a folder there are no shots")
    source = source_of(arguments)
    sensor = source.sensor
    shots = None
    if arguments.output is not None:
        shots = ShotFolder(output_folder(arguments.output), arguments.latest)
    scale = _scale(sensor.layout.width, sensor.pattern) if arguments.scale is None else arguments.scale
    preview = preview_maker(sensor, scale=scale, threads=arguments.threads)
    for note in source.notes:
        console.note(note)
    failed = False

    def refused(error: InputError) -> None:
        nonlocal failed
        failed = True
        console.error(str(error))

    with Stopping() as stopping:
        queue = FrameQueue(source.frames(stopping, refused, console.note), 1, stopped=stopping)
        finder = Viewfinder(lambda: queue.dropped, shots)
        with ViewfinderServer((arguments.bind, arguments.port), finder) as server:
            threading.Thread(target=server.serve_forever, args=(0.1,), name="viewfinder", daemon=True).start()
            console.say(f"the viewfinder is at {server.url}")
            try:
                show_frames(queue, sensor, preview, finder, refused)
            except InputError as error:  # the stream broke off
                refused(error)
            finally:
                finder.close()
                server.shutdown()
    return stopping.code or (FAILED if failed else 0)


def _scale(width: int, pattern: CfaPattern) -> int:
    """The smallest scale of the pattern at which the picture is no wider than _WIDEST, or its largest scale."""
    scales = Geometry.scales(pattern)
    return next((scale for scale in scales if width <= _WIDEST * scale), scales[-1])
