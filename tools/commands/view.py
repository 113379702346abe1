"""Show a camera's live picture on a web page, with frame rate, latency and dropped frames, and a
button that saves a shot.

SOURCE is as for `panchroma capture`. By default only this machine can open the page; with --bind
0.0.0.0 everybody on the network can, and with -o they can save shots too. The preview in a shot is
the picture that is shown; --scale 1 makes it a full one, and `panchroma preview` makes one of any
shot later. The command ends with exit code 1 when the camera ends or its stream loses bytes, and
after the current shot at SIGINT and SIGTERM (exit codes 130 and 0).
"""

import argparse
import re
import threading
from contextlib import closing
from functools import partial

from ...device.capture.frame_queue import FrameQueue
from ...device.capture.shots import ShotFolder
from ...shared.errors import InputError
from ..batch.console import Console, fault
from ..batch.jobs import FAILED, output_folder
from ..batch.signals import Stopping
from ..capture.frame_source import doubts, preview_maker
from ..capture.server import ViewfinderServer
from ..capture.viewfinder import Viewfinder, fitting_scale
from .frame_options import add_source, source_of
from .options import add, value

_HOST, _PORT = "127.0.0.1", 8000
_NAME = re.compile(r"[\w-]+(\.[\w-]+)*", re.ASCII)
_host = value(str.lower, "a name such as camera.example.org", _NAME.fullmatch)

USAGE = "SOURCE"
EXAMPLE = "panchroma view builtin:1200x800@10 -o shots"


def _host_and_port(text: str) -> tuple[str, int]:
    """Split "0.0.0.0:8000", "0.0.0.0", "::1" or "[::1]:8000"."""
    host, colon, port = text.rpartition(":")
    if not colon or (":" in host and not host.startswith("[")):
        host, port = text, str(_PORT)
    host = host.strip("[]")
    return _HOST if host in ("", "localhost") else host, int(port)


_address = value(_host_and_port, f"an address and a port, such as {_HOST}:{_PORT}")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma view`."""
    add_source(parser)
    folder = "folder for shots, created if missing; without it there is no button"
    add(parser, "output", required=False, help=folder)
    usual, address = f"{_HOST}:{_PORT}", "ADDRESS:PORT"
    reach = "for this machine alone; 0.0.0.0 for everybody on the network"
    serves = "network interface that serves the page, and port, 0 for any free one"
    interface = f"{serves} (default: {usual}, {reach})"
    parser.add_argument("--bind", metavar=address, type=_address, default=usual, help=interface)
    others = "beside its addresses and own names, or that of a proxy"
    own = f"name of this machine that browsers may ask for, {others}; repeat it for more"
    parser.add_argument("--host", metavar="NAME", type=_host, action="append", default=[], help=own)
    add(parser, "scale")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Serve the page until the source ends or the user does; returns the exit code."""
    source = source_of(arguments)
    sensor, scale, shots = source.sensor, arguments.scale, None
    if arguments.output is not None:
        shots = ShotFolder(output_folder(arguments.output))
    if scale is None:
        scale = fitting_scale(sensor.layout.width, sensor.pattern)
    preview = preview_maker(sensor, scale)
    console.note(*source.notes)
    failed = False

    def refused(error: InputError) -> None:
        nonlocal failed
        failed = True
        console.error(str(error))

    def report(error: BaseException) -> None:
        console.error(fault(error), cause=error)

    with closing(source), Stopping() as stopping:
        frames = FrameQueue(source.frames(stopping, refused, console.note), 1, stopped=stopping)
        finder = Viewfinder(lambda: source.lost() + frames.dropped, shots)
        with ViewfinderServer(arguments.bind, finder, report, arguments.host) as server:
            serve = partial(server.serve_forever, 0.1)
            threading.Thread(target=serve, name="viewfinder", daemon=True).start()
            console.say(f"the viewfinder is at {server.url}")
            try:
                finder.show_frames(frames, sensor, preview, refused)
                if source.waits and not stopping():
                    console.note("the recording has ended")
                elif not stopping():
                    pictures = f"{finder.status()['frames']} pictures"
                    refused(InputError(f"the camera has ended after {pictures}; start it again"))
            except InputError as error:  # the stream broke off
                refused(error)
                console.note(*doubts(finder.doubtful, error))
            finally:
                finder.close()
                server.shutdown()
    return stopping.code or (FAILED if failed else 0)
