"""The command line: a table of verbs, and the exit code of every error that ends a command."""

import argparse
import importlib
import io
import os
import signal
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import NoReturn

from .batch.console import Console, StandardOutputError, fault, note_warnings, one_line, to_stdout
from .batch.signals import INTERRUPTED, Terminated, orderly_end
from .io.versions import program_version

# Verb -> what it does, in the order of work. Each is a module of `tools.commands` that has
# `add_arguments(parser)` and `run(arguments, console)`, which returns the exit code. Only the
# requested one is imported, so that --help is fast.
VERBS = {
    "demo": "run the whole chain on a built-in scene, and compare it with a Bayer camera",
    "simulate": "photograph a scene (camera RAW or picture) with a simulated camera",
    "render": "make the full-quality pictures of shots",
    "burst": "merge a series of one scene into one picture, with less noise and more colour",
    "preview": "make the camera's own preview of shots",
    "inspect": "show what is in a shot; check whole archives for damage",
    "identify": "find out which pattern of filters the sensor has that took a raw frame",
    "capture": "save a camera's frames as shots, each with its preview",
    "view": "show a camera's live picture on a web page, with a button that saves a shot",
    "calibrate": "measure a camera's gamma, noise, black level and colours from a few shots",
    "evaluate": "compare this camera with Bayer cameras, and filter patterns with each other: "
    "figures, and a page to look at",
    "doctor": "check the installation, and say how to repair it",
}
GONE = {
    "design": "panchroma evaluate SCENE ... --pattern TILE,TILE compares tiles; "
    "offline/README.md, Which tile?, has the figures",
    "export-preview": "panchroma preview SHOT --export FILE.onnx",
    "--aberration": "a sparse-colour sensor hardly sees lateral chromatic aberration",
    "--defects": "list the pixels under defects in a camera.json, and use --camera",
    "--edges": "a sparse-colour sensor hardly sees lateral chromatic aberration",
    "--covered": "--unchecked is for frames of a covered lens, too",
    "--height": "--size 4056x3040",
    "--layout": "-f raw writes the samples alone",
    "--max-pixels": "the environment variable PANCHROMA_MAX_PIXELS sets the limit",
    "--moving": "the scene of a burst stands still",
    "--no-chart": "gamma is measured from a chart",
    "--no-page": "the page is always written",
    "--period": "--pattern K=4 is the paper's pattern with the period 4",
    "--port": "--bind ADDRESS:PORT",
    "--protocol": "--sigma or --light says which noise is meant",
    "--report": "panchroma burst --json says what became of each frame",
    "--rotation": "--motion moves the frames of a burst",
    "--scheduler-file": "--scheduler takes the address of the scheduler",
    "--sensor-bits": "--bits N",
    "--shard": "several runs with --resume share one folder",
    "--show": "the page shows the squares where methods differ most",
    "--threads": "-j sets processes; the environment variable PANCHROMA_THREADS sets the threads "
    "of each",
    "--uncertainty": "how far a pixel may be off is no longer stated",
    "--width": "--size 4056x3040",
    "--wait": "a recording waits by itself: panchroma capture - < FILE",
    "--workers": "-j N",
}
"""Verbs and options of earlier versions -> what to use instead, or why they are not needed."""
_STILL = {"--report": ("calibrate",)}  # verbs that have an option that others have lost
FAILED, USAGE = 1, 2


class _Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are one line whatever the arguments contain, and whose reader
    may leave.
    """

    def print_help(self, file: object = None) -> None:
        to_stdout(self.format_help().rstrip("\n"))

    def error(self, message: str) -> NoReturn:
        super().error(one_line(message))


class _Version(argparse.Action):
    """Prints the version; argparse's own action is silent where it cannot be printed."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        to_stdout(f"panchroma {program_version()}")
        parser.exit()


def main(argv: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit with 0 (ok), 1 (some files failed), 2 (usage), 130
    (interrupted) or 143 (terminated).
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    _open_streams()
    console = Console(verbose=not {"-v", "--verbose"}.isdisjoint(arguments))
    try:
        with orderly_end(last=argv is None), warnings.catch_warnings():
            code = 0
            try:
                parser = build_parser(next((word for word in arguments if word in VERBS), ""))
                _refuse_removed(parser, arguments)
                parsed = parser.parse_args(arguments)
                options = {"quiet": parsed.quiet, "verbose": parsed.verbose}
                console = Console(json=getattr(parsed, "json", False), **options)
                note_warnings(console.note)
                code, verb = FAILED, _module(parsed.verb)
                code = verb.run(parsed, console)
            finally:
                if code:
                    from .batch import jobs  # not at the top: it imports NumPy

                    jobs.remove_unused_folders()
                console.close()
    except KeyboardInterrupt as stop:
        console.error("interrupted; finished files are complete, and no partial file is left")
        code = stop.code if isinstance(stop, Terminated) else INTERRUPTED
    except StandardOutputError as error:
        code = _without_stdout(error, console)
    except Exception as error:
        from ..shared.errors import PanchromaError

        expected = isinstance(error, PanchromaError)
        console.error(str(error) if expected else fault(error), cause=error)
        code = USAGE if expected else FAILED
    sys.exit(code)


def build_parser(verb: str) -> argparse.ArgumentParser:
    """Return the parser of the command line.

    Parameters
    ----------
    verb : str
        The only one whose options are added; importing all would take a second.
    """
    parser = _Parser(
        prog="panchroma",
        usage="panchroma VERB ... [options]",
        description="Software of a sparse-colour camera: simulate it, calibrate it, render its "
        "shots.",
        epilog="panchroma VERB --help shows the options of a verb.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    _add_common(parser, quiet=False, verbose=False)
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True, prog="panchroma")
    for name, summary in VERBS.items():
        child = verbs.add_parser(
            name,
            help=summary,
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            usage=f"panchroma {name} ...",
        )
        if name == verb:
            module = _module(name)
            child.description = module.__doc__
            child.usage = " ".join(f"panchroma {name} {module.USAGE} [options]".split())
            child.epilog = f"example:\n  {module.EXAMPLE}"
            module.add_arguments(child)
            _add_common(child, quiet=argparse.SUPPRESS, verbose=argparse.SUPPRESS)
    return parser


def _add_common(parser: argparse.ArgumentParser, quiet: object, verbose: object) -> None:
    """Add the options of every verb, which may stand before the verb, too; their defaults."""
    less = "show neither progress nor notes; errors and results remain"
    parser.add_argument("-q", "--quiet", action="store_true", default=quiet, help=less)
    more = "show the traceback of what caused an error"
    parser.add_argument("-v", "--verbose", action="store_true", default=verbose, help=more)


def _refuse_removed(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> None:
    """End with usage and what to use instead if a verb or an option is one of earlier versions."""
    verb = next((word for word in arguments if not word.startswith("-")), "")
    if verb in GONE:
        parser.error(f"there is no verb {verb} any more: {GONE[verb]}")
    for word in arguments:
        option = word.partition("=")[0]
        if word == "--":
            return
        if option.startswith("--") and option in GONE and verb not in _STILL.get(option, ()):
            parser.error(f"there is no option {option} any more: {GONE[option]}")


def _module(verb: str) -> ModuleType:
    return importlib.import_module(f"panchroma.tools.commands.{verb}")


def _open_streams() -> None:
    """Make both streams writable: the caller may have closed one, and file names may not fit the
    locale's encoding.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _without_stdout(error: StandardOutputError, console: Console) -> int:
    """The exit code after standard output has failed; what is written to it from now on is
    discarded.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if error.closed:  # the reader (head, a closed pager) has seen enough
        return 128 + signal.SIGPIPE
    console.error(str(error))
    return FAILED
