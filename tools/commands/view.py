"""Show what a camera sees on a web page, with frame rate, latency and dropped frames, and a button that saves the frame.

SOURCE is that of `panchroma capture`. The page is for this machine alone; --bind 0.0.0.0 shows it to the network, where everybody
can look and (with -o) save. SIGINT and SIGTERM end it after the shot in hand (exit codes 130 and 0).
"""

import argparse
import threading
from pathlib import Path

from device.frame_queue import FrameQueue
from device.geometry import Geometry
from device.shots import ShotFolder
from shared import CfaPattern
from shared.errors import InputError
from tools.host.console import Console
from tools.host.jobs import FAILED, output_folder
from tools.host.signals import Stopping
from tools.live.server import ViewfinderServer
from tools.live.source import add_source_options, open_source
from tools.live.viewfinder import Viewfinder
from tools.pictures.previews import add_graph_option, preview_maker

_WIDEST = 1440  # pixels: more do not fit a phone or a page, and cost the camera time


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Of `panchroma view`."""
    add_source_options(parser)
    parser.add_argument("-o", "--output", metavar="DIR", help="existing folder for shots; without it there is no button")
    parser.add_argument("--latest", metavar="LINK", help="keep a symbolic link to the latest shot there")
    parser.add_argument("--bind", default="127.0.0.1", metavar="ADDRESS", help="network interface to serve")
    parser.add_argument("--port", type=int, default=8000, help="0 takes any that is free")
    parser.add_argument(
        "--scale", type=int, metavar="S", help=f"one pixel for S x S of the sensor (default: 1 up to {_WIDEST} pixels of width)"
    )
    add_graph_option(parser)
    parser.add_argument("-j", "--jobs", type=int, metavar="N", help="threads of the preview (default: one per core)")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Returns the exit code."""
    if arguments.jobs is not None and arguments.jobs < 1:
        raise InputError(f"--jobs is {arguments.jobs}, expected 1 or more")
    if arguments.latest and not arguments.output:
        raise InputError("--latest needs -o DIR: without a folder there are no shots")
    source = open_source(arguments)
    sensor = source.sensor
    shots = None
    if arguments.output:
        folder = ShotFolder(output_folder(arguments.output), Path(arguments.latest) if arguments.latest else None)
        # One thread: a shot must not hold up the picture on other cores.
        shots = folder, preview_maker(sensor, graph=arguments.graph, threads=1)
    scale = arguments.scale
    if scale is None:
        scale = 1 if arguments.graph else _scale(sensor.layout.width, sensor.pattern)
    preview = preview_maker(sensor, graph=arguments.graph, scale=scale, threads=arguments.jobs)
    for note in source.notes:
        console.note(note)
    failed = False

    def refused(error: InputError) -> None:
        nonlocal failed
        failed = True
        console.error(str(error))

    with Stopping() as stopping:
        queue = FrameQueue(source.frames(stopping, refused), 1, stopped=stopping)
        finder = Viewfinder(preview, lambda: queue.dropped, shots)
        with ViewfinderServer((arguments.bind, arguments.port), finder) as server:
            threading.Thread(target=server.serve_forever, args=(0.1,), name="viewfinder", daemon=True).start()
            console.say(f"the viewfinder is at {server.url}")
            try:
                for frame in queue:
                    try:
                        finder.show(frame, sensor.mosaic(frame))
                    except InputError as error:
                        refused(error)
            except InputError as error:  # the stream broke off
                refused(error)
            finally:
                finder.close()
                server.shutdown()
    return stopping.code or (FAILED if failed else 0)


def _scale(width: int, pattern: CfaPattern) -> int:
    """The smallest scale that makes the picture no wider than the page, or the largest that the pattern has."""
    scales = Geometry.scales(pattern)
    return next((scale for scale in scales if width <= _WIDEST * scale), scales[-1])
