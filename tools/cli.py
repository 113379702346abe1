"""The command line: a table of verbs. The only place that catches Panchroma's errors."""

import argparse
import importlib
import io
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import NoReturn

from tools.host.console import Console, StandardOutputError, fault
from tools.host.signals import INTERRUPTED, Terminated, orderly_end
from tools.host.versions import program_version

# Verb -> what it does. Each is a module of this package (_ for -) with `add_arguments(parser)` and `run(arguments, console) -> exit
# code`; only the one that is asked for is imported, so that help comes at once.
VERBS = {
    "demo": "run the whole chain on the built-in scene",
    "simulate": "photograph a scene (camera RAW or picture) with the sparse-colour camera",
    "inspect": "say what is in a shot",
    "capture": "save a camera's frames as shots, each with its preview",
    "view": "show what a camera sees on a web page, with a button to save it",
    "preview": "make the camera's own picture of a shot",
    "render": "make the full-quality picture of a shot",
    "evaluate": "compare this camera with Bayer cameras on scenes: figures, and a page to look at",
    "bench": "measure how fast everything is, and how fast others are",
    "export-preview": "write the graph that makes a camera's previews",
    "doctor": "check the installation, and say how to mend it",
    "calibrate": "measure a camera's gamma, noise, black level and colours from a few shots",
}


class _Help(argparse.ArgumentDefaultsHelpFormatter):
    """Shows a default where there is one to know."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        return action.help if action.default in (None, False) else super()._get_help_string(action)


FAILED, USAGE = 1, 2


def main(argv: Sequence[str] | None = None) -> NoReturn:
    """Entry point of `panchroma`; leaves with 0 (ok), 1 (some files failed), 2 (usage), 130 (interrupted) or 143 (terminated)."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    _open_streams()
    console = Console()
    try:
        with orderly_end():
            # Not above: it brings NumPy, and whoever interrupts that is to see no traceback.
            from shared.errors import PanchromaError

            try:
                parsed = _parser(arguments).parse_args(arguments)
                console = Console(json=getattr(parsed, "json", False))
                _set_threads(parsed)
                code: int = _module(parsed.verb).run(parsed, console)
            finally:
                console.close()
    except KeyboardInterrupt as stop:
        console.error("interrupted; every file that was finished is whole, no other was begun")
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
    """Make both streams writable: a caller may have closed one, and a file name need not be text of the locale's encoding."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")


def _without_stdout(error: StandardOutputError, console: Console) -> int:
    """The exit code when standard output takes no more; nothing will be written to it again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if error.closed:  # the reader (head, a closed pager) has seen enough
        return 128 + signal.SIGPIPE
    console.error(str(error))
    return FAILED


def _parser(arguments: list[str]) -> argparse.ArgumentParser:
    """The whole table, but the options only of the verb in `arguments`."""
    parser = argparse.ArgumentParser(
        prog="panchroma",
        description="Software of a sparse-colour camera: simulate it, look into its shots, render them.",
        epilog="panchroma VERB --help tells the options of each.",
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
    return parser


def _set_threads(parsed: argparse.Namespace) -> None:
    """How many the renderer has (-j, or as many as there are processors), and what they do while they wait."""
    if parsed.verb != "bench":  # which measures libraries as they are
        # They sleep: beside other programs at work, spinning ones cost half the speed. OpenMP reads it when it is loaded.
        os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    count: int | None = getattr(parsed, "threads", None)
    if count is None:
        return
    from offline import available_threads, use_threads
    from shared.errors import InputError

    if count < 1:
        raise InputError(f"-j is {count}, expected 1 or more")
    use_threads(min(count, available_threads()))


def _module(verb: str) -> ModuleType:
    return importlib.import_module(f"tools.commands.{verb.replace('-', '_')}")
