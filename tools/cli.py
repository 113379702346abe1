"""The command line: a table of verbs, and the exit code of every error that ends a command."""

import argparse
import atexit
import gc
import importlib
import io
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from tools.host.console import Console, StandardOutputError, fault, one_line, to_stdout
from tools.host.signals import INTERRUPTED, Terminated, orderly_end
from tools.host.versions import program_version

# Verb -> what it does. Each is a module of `tools.commands` (with _ for -) that has `add_arguments(parser)` and `run(arguments,
# console)`, which returns the exit code. Only the one that is asked for is imported, so that --help is fast.
VERBS = {
    "demo": "run the whole chain on a built-in scene, and compare it with a Bayer camera",
    "simulate": "photograph a scene (camera RAW or picture) with a simulated camera",
    "inspect": "show what is in a shot; check whole archives for damage",
    "capture": "save a camera's frames as shots, each with its preview",
    "view": "show a camera's live picture on a web page, with a button that saves a shot",
    "preview": "make the camera's own preview of shots",
    "render": "make the full-quality pictures of shots",
    "burst": "merge a series of one scene into one picture, with less noise and more colour",
    "evaluate": "compare this camera with Bayer cameras, and filter patterns with each other: figures, and a page to look at",
    "bench": "measure the speed of Panchroma and of other programs",
    "export-preview": "write the graph that makes a camera's previews",
    "doctor": "check the installation, and say how to repair it",
    "calibrate": "measure a camera's gamma, noise, black level and colours from a few shots",
}


class _Parser(argparse.ArgumentParser):
    """Shows wrong arguments, whatever they contain, on one line, and texts to readers who may leave."""

    def error(self, message: str) -> NoReturn:
        super().error(one_line(message))

    def _print_message(self, message: str, file: Any = None) -> None:  # argparse's own lets errors out or drops them
        if file is sys.stdout:
            to_stdout(message.rstrip("\n"))
        else:
            with suppress(OSError):
                sys.stderr.write(message)


class _Help(argparse.ArgumentDefaultsHelpFormatter):
    """Shows defaults, except None, False and empty ones, which say nothing."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return action.help if action.default in (None, False, []) else super()._get_help_string(action)


FAILED, USAGE = 1, 2


def main(argv: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit with 0 (ok), 1 (some files failed), 2 (usage), 130 (interrupted) or 143 (terminated)."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    _open_streams()
    console = Console()
    try:
        with orderly_end(last=argv is None):
            # Not at the top: this imports NumPy, and an interrupt meanwhile must not show a traceback.
            from shared.errors import PanchromaError
            from tools.host.jobs import remove_unused_folders

            if argv is None:
                atexit.register(gc.freeze)  # at the end the collector would look at all of Numba, for a quarter of a second
            code = FAILED
            try:
                parsed = _parser(arguments).parse_args(arguments)
                console = Console(json=getattr(parsed, "json", False), quiet=parsed.quiet)
                _set_threads(parsed)
                code = _module(parsed.verb).run(parsed, console)
            finally:
                if code:
                    remove_unused_folders()
                console.close()
    except KeyboardInterrupt as stop:
        console.error("interrupted; finished files are complete, and no partial file is left")
        code = stop.code if isinstance(stop, Terminated) else INTERRUPTED
    except PanchromaError as error:
        console.error(str(error))
        code = USAGE
    except StandardOutputError as error:
        code = _without_stdout(error, console)
    except Exception as error:
        console.error(fault(error))
        code = FAILED
    sys.exit(code)


def _open_streams() -> None:
    """Make both streams writable: the caller may have closed one, and file names may not fit the locale's encoding."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _without_stdout(error: StandardOutputError, console: Console) -> int:
    """The exit code after standard output has failed; what is written to it from now on is discarded."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if error.closed:  # the reader (head, a closed pager) has seen enough
        return 128 + signal.SIGPIPE
    console.error(str(error))
    return FAILED


def _parser(arguments: list[str]) -> argparse.ArgumentParser:
    """The parser with all verbs, but only with the options of the verb in `arguments`."""
    parser = _Parser(
        prog="panchroma",
        description="Software of a sparse-colour camera: simulate it, calibrate it, render its shots.",
        epilog="panchroma VERB --help shows the options of a verb.",
    )
    parser.add_argument("--version", action="version", version=f"panchroma {program_version()}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    asked = next((word for word in arguments if word in VERBS), None)
    for verb, summary in VERBS.items():
        child = verbs.add_parser(verb, help=summary, formatter_class=_Help)
        if verb == asked:
            module = _module(verb)
            child.description = module.__doc__
            module.add_arguments(child)
            child.add_argument("--quiet", action="store_true", help="show neither progress nor notes; errors and results remain")
    return parser


def _set_threads(parsed: argparse.Namespace) -> None:
    """Set the number of threads of the renderer (-j, by default one per processor), and let idle ones sleep."""
    if parsed.verb != "bench":  # which measures libraries with their own settings
        # Beside other busy programs, spinning threads cost half the speed. OpenMP reads this when it is loaded.
        os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    count: int | None = getattr(parsed, "threads", None)
    if count is None:
        return
    from offline import available_threads, use_threads
    from tools.host.options import check_at_least_one

    check_at_least_one(parsed, "threads")
    use_threads(min(count, available_threads()))


def _module(verb: str) -> ModuleType:
    return importlib.import_module(f"tools.commands.{verb.replace('-', '_')}")
