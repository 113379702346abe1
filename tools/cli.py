"""The command line: a table of verbs, and the exit code of every error that ends a command."""

import argparse
import importlib
import io
import os
import re
import signal
import sys
import warnings
from collections.abc import Iterable, Sequence
from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from tools.batch.console import Console, StandardOutputError, fault, note_warnings, one_line, to_stdout
from tools.batch.signals import INTERRUPTED, Terminated, orderly_end
from tools.io.versions import program_version

# Verb -> what it does. Each is a module of `tools.commands` (with _ for -) that has `add_arguments(parser)` and `run(arguments,
# console)`, which returns the exit code. Only the one that is asked for is imported, so that --help is fast.
VERBS = {
    "demo": "run the whole chain on a built-in scene, and compare it with a Bayer camera",
    "simulate": "photograph a scene (camera RAW or picture) with a simulated camera",
    "inspect": "show what is in a shot; check whole archives for damage",
    "identify": "find out which pattern of filters the sensor has that took a raw frame",
    "capture": "save a camera's frames as shots, each with its preview",
    "view": "show a camera's live picture on a web page, with a button that saves a shot",
    "preview": "make the camera's own preview of shots",
    "render": "make the full-quality pictures of shots",
    "burst": "merge a series of one scene into one picture, with less noise and more colour",
    "evaluate": "compare this camera with Bayer cameras, and filter patterns with each other: figures, and a page to look at",
    "doctor": "check the installation, and say how to repair it",
    "calibrate": "measure a camera's gamma, noise, black level and colours from a few shots",
}


GONE = {
    "design": "panchroma evaluate SCENE ... --pattern TILE ... compares tiles; offline/README.md, Which tile?, has the figures",
    "export-preview": "panchroma preview SHOT --export FILE.onnx",
    "--report": "panchroma burst --json says what became of each frame",
    "--show": "the page shows the squares where methods differ most",
    "--uncertainty": "how far a pixel may be off is no longer stated",
    "--aberration": "a sparse-colour sensor hardly sees lateral chromatic aberration",
    "--edges": "a sparse-colour sensor hardly sees lateral chromatic aberration",
    "--no-chart": "gamma is measured from a chart",
}
"""Verbs and options of earlier versions -> what to use instead, or why they are not needed."""


class _Parser(argparse.ArgumentParser):
    """Shows wrong arguments, whatever they contain, on one line after one of usage, and texts to readers who may leave."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._negative_number_matcher = re.compile(r"-\.?\d.*")  # argparse takes -2,0 for an option otherwise

    def error(self, message: str) -> NoReturn:
        super().error(one_line(message))

    def format_usage(self) -> str:
        """One line: what has to be there, and that there are options."""
        named = [action for action in self._actions if action.required or not action.option_strings]
        words = [
            f"{action.option_strings[0]} {action.metavar}"
            if action.option_strings
            else f"{action.metavar}{' ...' * bool(action.nargs)}"
            for action in sorted(named, key=lambda action: bool(action.option_strings))
            if action.help != argparse.SUPPRESS
        ]
        return f"usage: {self.prog} {' '.join([*words, '[options]'])}\n"

    def format_help(self) -> str:
        """The help, with that line."""
        self.usage = one_line(self.format_usage().removeprefix("usage: ").strip()).replace("%", "%%")
        return super().format_help()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse, but a verb itself refuses what it does not know, before it misses anything, with its own usage."""
        known = self._option_string_actions
        if self._subparsers is None:
            for option in takewhile("--".__ne__, args):
                if self._is_unknown(option.partition("=")[0]):
                    self.error(_unknown_option(option.partition("=")[0], known))
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            word = unknown[0]
            self.error(_unknown_option(word, known) if word.startswith("-") else f"{word} is one argument too many")
        return found, unknown

    def _is_unknown(self, word: str) -> bool:
        """Whether a word looks like an option and is none, nor the beginning of one, nor a short one with its value."""
        if len(word) < 2 or not word.startswith("-") or " " in word or self._negative_number_matcher.match(word):
            return False
        known = self._option_string_actions
        return not (any(each.startswith(word) for each in known) or (word[1] != "-" and word[:2] in known))

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        try:
            return super()._get_value(action, arg_string)
        except argparse.ArgumentError as error:
            expected = {int: "a whole number", float: "a number"}.get(action.type)  # type: ignore[call-overload]
            raise argparse.ArgumentError(action, f"{arg_string!r} is not {expected}" if expected else error.message) from None

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            from shared.spelling import meant

            names = [str(choice) for choice in action.choices]
            raise argparse.ArgumentError(action, f"{value!r} is none of {', '.join(names)}{meant(str(value), names)}")

    def _print_message(self, message: str, file: Any = None) -> None:  # argparse's own lets errors out or drops them
        if file is sys.stdout:
            to_stdout(message.rstrip("\n"))
        else:
            with suppress(OSError):
                sys.stderr.write(message)


class _Help(argparse.HelpFormatter):
    """Shows defaults, except those that say nothing: None, False, empty ones, and those that the help names."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        default, said = action.default, action.help or ""
        if (
            default in (None, (), [], argparse.SUPPRESS)
            or isinstance(default, bool)
            or "(default" in said
            or not action.option_strings
        ):
            return action.help
        values = default if isinstance(default, list) else [default]
        return f"{said} (default: {' '.join(f'{each:g}' if isinstance(each, float) else str(each) for each in values)})"


FAILED, USAGE = 1, 2
_ALONE = ("--help", "--version")  # options without a verb
# Options of every verb, which may also stand before it.
_QUIET, _VERBOSE = ("-q", "--quiet"), ("-v", "--verbose")


def main(argv: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit with 0 (ok), 1 (some files failed), 2 (usage), 130 (interrupted) or 143 (terminated)."""
    arguments = _verb_first(list(sys.argv[1:] if argv is None else argv))
    _open_streams()
    console = Console(verbose=(verbose := not set(_VERBOSE).isdisjoint(arguments)))
    try:
        with orderly_end(last=argv is None), warnings.catch_warnings():
            code = 0
            try:
                _check_verb(arguments)
                parser, verbs = _parser(arguments[0])
                options = _options(verbs[arguments[0]]) if arguments[0] in verbs else {}
                console = Console(verbose=verbose, options=options)
                parsed = parser.parse_args(arguments)
                as_json = getattr(parsed, "json", False)
                console = Console(json=as_json, quiet=parsed.quiet, verbose=parsed.verbose, options=options)
                note_warnings(console.note)
                code, verb = FAILED, _module(parsed.verb)
                code = verb.run(parsed, console)
            finally:
                if code:
                    from tools.batch.jobs import remove_unused_folders  # not at the top: it imports NumPy

                    remove_unused_folders()
                console.close()
    except KeyboardInterrupt as stop:
        console.error("interrupted; finished files are complete, and no partial file is left")
        code = stop.code if isinstance(stop, Terminated) else INTERRUPTED
    except StandardOutputError as error:
        code = _without_stdout(error, console)
    except Exception as error:
        from shared.errors import PanchromaError

        expected = isinstance(error, PanchromaError)
        console.error(str(error) if expected else fault(error), cause=error)
        code = USAGE if expected else FAILED
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


def _parser(asked: str | None) -> tuple[_Parser, dict[str, _Parser]]:
    """The parser of all, and that of each verb; only the verb that is asked for has its options."""
    parser = _Parser(
        prog="panchroma",
        description="Software of a sparse-colour camera: simulate it, calibrate it, render its shots.",
        epilog="panchroma VERB --help shows the options of a verb.",
    )
    asks_version = asked and "--version".startswith(asked)  # to look it up takes longer than all else here
    parser.add_argument("--version", action="version", version=f"panchroma {program_version()}" if asks_version else "")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for verb, summary in VERBS.items():
        child = verbs.add_parser(verb, help=summary, formatter_class=_Help)
        if verb == asked:
            module = _module(verb)
            child.description = module.__doc__
            module.add_arguments(child)
            child.add_argument(*_QUIET, action="store_true", help="show neither progress nor notes; errors and results remain")
            child.add_argument(*_VERBOSE, action="store_true", help="show the traceback of an error that is a fault of Panchroma")
    return parser, verbs.choices


def _options(parser: _Parser) -> dict[str, str]:
    """What the libraries' texts call an option, its argument's name -> the option."""
    return {action.dest: action.option_strings[-1] for action in parser._actions if action.option_strings}


def _verb_first(arguments: list[str]) -> list[str]:
    """The arguments, with what stands before the verb and belongs to every verb behind it."""
    common = list(takewhile((*_QUIET, *_VERBOSE).__contains__, arguments))
    verb, *others = arguments[len(common) :] or [""]
    return [verb, *common, *others]


def _check_verb(arguments: list[str]) -> None:
    """End with usage and what is wrong, unless the first argument is a verb, or asks for help or the version."""
    word = arguments[0] if arguments else ""
    if word in VERBS or (word.startswith("-") and any(each.startswith(word) for each in ("-h", *_ALONE))):
        return
    if word in GONE:
        _parser(None)[0].error(f"there is no verb {word} any more: {GONE[word]}")
    from shared.spelling import closest

    later = next((each for each in arguments if each in VERBS), None)
    likely = closest(word, VERBS) or later
    parser, verbs = _parser(likely)
    if later and likely == later:
        verbs[later].error(f"the verb comes first: panchroma {later} ...")
    if likely:
        verbs[likely].error(f"there is no verb {word}; did you mean {likely}?")
    if word.startswith("-"):
        parser.error(_unknown_option(word, _ALONE))
    parser.error(f"{f'there is no verb {word}' if word else 'a verb is missing'}; panchroma --help lists them")


def _unknown_option(option: str, known: Iterable[str]) -> str:
    from shared.spelling import meant  # not at the top: it imports NumPy

    if option in GONE:
        return f"there is no option {option} any more: {GONE[option]}"
    return f"there is no option {option}{meant(option, known)}"


def _module(verb: str) -> ModuleType:
    return importlib.import_module(f"tools.commands.{verb.replace('-', '_')}")
