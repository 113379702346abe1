"""The command line: a table of verbs, and the exit code of every error that ends a command."""

import argparse
import io
import logging
import os
import re
import signal
import sys
from collections.abc import Collection, Iterable, Sequence
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from typing import Any, NoReturn

from .batch.console import Console, StandardOutputError, fault, one_line, shown_by, to_stdout
from .batch.signals import INTERRUPTED, Terminated, orderly_end
from .io.versions import program_version, versions

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
    "completion": "print the script that lets a shell complete commands",
}
_COMMANDS = "panchroma.tools.commands."
FAILED, USAGE = 1, 2
_ENVIRONMENT = """
environment variables:
  PANCHROMA_THREADS     threads of each process (default: one per processor)
  PANCHROMA_MAX_PIXELS  pixels of the largest file that is read (default: 268435456)
  NUMBA_CACHE_DIR       folder of compiled kernels (default: beside the sources)"""

# The library marks the names of arguments, with or without a value: `sigma`, `overwrite=True`.
_RENAMED = {"width": "size", "height": "size"}  # where names differ
_SIZE = {"width": "{}xHEIGHT", "height": "WIDTHx{}"}
_VARIABLES = {"max_pixels": "the environment variable PANCHROMA_MAX_PIXELS"}
_ARGUMENT = re.compile(r"`([a-z_]+)(?:=([^`]*))?`")

_NEGATIVE = re.compile(r"-[\d.]+[/,][-\d./,]+")  # numbers that argparse would take for an option


class _Parser(argparse.ArgumentParser):
    """An ArgumentParser whose errors are one line whatever the arguments contain, and whose reader
    may leave. Options are written in full.
    """

    def __init__(self, **settings: Any) -> None:
        formatter = argparse.RawDescriptionHelpFormatter
        super().__init__(formatter_class=formatter, allow_abbrev=False, **settings)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Read the command line. A space before numbers such as -1/3 and -2,0 tells argparse that
        they are no option.
        """
        given = sys.argv[1:] if args is None else args
        words = [f" {word}" if _NEGATIVE.fullmatch(word) else word for word in given]
        return super().parse_known_args(words, namespace)

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
    if arguments[:1] == ["help"]:
        arguments = [*arguments[1:2], "--help"]
    console = Console(verbose=not {"-v", "--verbose"}.isdisjoint(arguments))
    try:
        with orderly_end(last=argv is None):
            code, common = 0, list(takewhile(lambda word: word.startswith("-"), arguments))
            verb, *words = arguments[len(common) :] or [""]
            try:
                parser, own = build_parser(verb)
                _refuse_misspelt(parser, common)
                if verb and verb not in VERBS:
                    parser.error(f"there is no verb {verb}{_likeliest(verb, VERBS)}")
                console.spell = partial(spelled, options=_options(own))
                _refuse_misspelt(own, words)
                parsed, unexpected = parser.parse_known_args(arguments)
                if unexpected:
                    own.error(f"unexpected argument: {unexpected[0]!r}")
                console.json = getattr(parsed, "json", False)
                console.quiet, console.verbose = parsed.quiet, parsed.verbose
                code = FAILED
                with shown_by(console.note, logging.INFO if console.verbose else logging.WARNING):
                    if console.verbose:
                        console.note(versions())
                    code = import_module(_COMMANDS + verb).run(parsed, console)
            finally:
                if code:
                    from .batch import jobs  # not at the top: it imports NumPy

                    jobs.remove_unused_folders()
                to_stdout()  # what is left in its buffer
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


def build_parser(
    *used: str, store: type[argparse.Action] | None = None
) -> tuple[argparse.ArgumentParser, argparse.ArgumentParser]:
    """Return the parser of the command line, and that of the last of these verbs, the same without
    a verb.

    *used: the verbs whose options are added; importing all would take a second. store: the action
    of their arguments that take values; None = that of argparse.
    """
    usage = "panchroma VERB ... [options]"
    about = "Software of a sparse-colour camera: simulate it, calibrate it, render its shots."
    more = f"panchroma help VERB shows the options of a verb.\n{_ENVIRONMENT}"
    parser = _Parser(prog="panchroma", usage=usage, description=about, epilog=more)
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    _add_common(parser, quiet=False, verbose=False)
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True, prog="panchroma")
    own: argparse.ArgumentParser = parser
    for name, summary in VERBS.items():
        child = verbs.add_parser(name, help=summary, usage=f"panchroma {name} ...")
        if name in used:
            own = child
            if store:
                own.register("action", None, store)
            module = import_module(_COMMANDS + name)
            child.description = module.__doc__
            child.usage = " ".join(f"panchroma {name} {module.USAGE} [options]".split())
            child.epilog = f"example:\n  {module.EXAMPLE}\n{_ENVIRONMENT}"
            module.add_arguments(child)
            _add_common(child, quiet=argparse.SUPPRESS, verbose=argparse.SUPPRESS)
    return parser, own


def _add_common(parser: argparse.ArgumentParser, quiet: object, verbose: object) -> None:
    """Add the options of every verb, which may stand before the verb, too; their defaults."""
    less = "show neither progress nor notes; errors and results remain"
    parser.add_argument("-q", "--quiet", action="store_true", default=quiet, help=less)
    more = "show versions, what each stage does and takes, and tracebacks of errors"
    parser.add_argument("-v", "--verbose", action="store_true", default=verbose, help=more)


def _options(parser: argparse.ArgumentParser) -> list[str]:
    """Return the options of a parser, which its help lists."""
    listed = re.findall(r"^ {2}(-.*?)(?: {2}|$)", parser.format_help(), re.MULTILINE)
    return [option for line in listed for option in re.findall(r"(?:^|, )(--?[\w-]+)", line)]


def _refuse_misspelt(parser: argparse.ArgumentParser, words: Sequence[str]) -> None:
    """End with usage, and the likeliest option, if one of the words is an option that the parser
    has not. Nothing else is complained of before.
    """
    options = _options(parser)
    before = list(takewhile(lambda word: word != "--", words))
    if {"-h", "--help"} & {*before}:
        return
    for word in before:
        name = word.partition("=")[0]
        is_short = name[:2] in options and f"-{name}" not in options  # -o DIR, -oDIR, -qv
        is_option = re.match("--|-[A-Za-z]", name) and " " not in word
        if is_option and not is_short and name not in options:
            parser.error(f"there is no option {name}{_likeliest(name, options)}")


def _likeliest(name: str, known: Iterable[str]) -> str:
    """Return words that ask for what was meant, "" if nothing is like it."""
    plain = {word.lstrip("-"): word for word in known}
    name = name.lstrip("-").replace("_", "-").lower()
    begun = [word for word in plain if word.startswith(name)]
    likely = (begun or get_close_matches(name, plain, 1))[:1]
    return f"; did you mean {plain[likely[0]]}?" if likely else ""


def option_of(argument: str) -> str:
    """Return the option that sets an argument of the library, whichever verb has it."""
    return f"--{_RENAMED.get(argument, argument).replace('_', '-')}"


def spelled(message: str, options: Collection[str]) -> str:
    """Return a message with options in place of the arguments that it names.

    An argument that is none of these options, those of a verb, becomes plain words.

    Examples
    --------
    >>> spelled("exists already; use `overwrite=True` to replace it", ["--overwrite"])
    'exists already; use --overwrite to replace it'
    """

    def option(match: re.Match[str]) -> str:
        name, value = match[1], match[2] or ""
        if name in _VARIABLES:
            return _VARIABLES[name]
        value = _SIZE.get(name, "{}").format(value.strip('"')) if value not in ("", "True") else ""
        known = option_of(name)
        return f"{known if known in options else name.replace('_', ' ')} {value}".rstrip()

    if "--overwrite" not in options:
        message = message.replace("use `overwrite=True` to replace it", "choose another folder")
    return _ARGUMENT.sub(option, re.sub("`width`(,| and| or) `height`", "`size`", message))


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
