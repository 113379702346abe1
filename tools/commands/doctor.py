"""Check the installation (versions, missing packages, kernels, threads, memory, writing) and say how to repair what is wrong.

With --compile, compile the renderer for this processor first: for images of machines, clusters, and those who do not want to wait later.
"""

import argparse
import time

from shared.errors import InputError
from tools.host import options
from tools.host.compilation import CACHE_REMEDY, compile_all
from tools.host.console import Console
from tools.host.installation import BAD, CHECKS, MISSING, Finding
from tools.host.jobs import FAILED
from tools.host.processors import processors


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma doctor`."""
    parser.add_argument(
        "--compile",
        action="store_true",
        help="first compile all of the renderer that is not compiled yet; what is compiled serves this version of Panchroma on "
        "processors of this model, wherever it finds the same cache folder (the line 'kernel cache' names it)",
    )
    options.add_json(parser, "check")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Show what every check finds; returns the exit code: 1 when something is wrong, 0 when something optional is missing."""
    if arguments.compile:
        _compile(console)
    findings = [finding for check in CHECKS for finding in check()]
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        console.say(*_lines(finding, width))
        console.record(check=finding.name, ok=finding.state != BAD, state=finding.state, found=finding.found, remedy=finding.remedy)
    wrong = sum(finding.state == BAD for finding in findings)
    missing = sum(finding.state == MISSING for finding in findings)
    console.say(f"{wrong} wrong, {missing} optional things missing" if wrong or missing else "all is well")
    return FAILED if wrong else 0


def _compile(console: Console) -> None:
    """Compile all kernels that are not in the cache. Raises InputError when they cannot be compiled or kept."""
    try:
        from offline import kernels_to_compile
    except ModuleNotFoundError as error:
        raise InputError(f"there is nothing to compile without {error.name}: pip install -e '.[all]'") from None
    try:
        names = kernels_to_compile()
        if names:
            start = time.monotonic()
            with console.progress("doctor") as progress:
                progress.stage("compiling", len(names))
                for number, (name, error) in enumerate(compile_all(names, processors(), console.note), 1):
                    if isinstance(error, BaseException):
                        raise InputError(f"{name}: {error}") from None
                    progress.advance()
                    progress.remark(f"compiled kernel {number} of {len(names)}")
            console.say(f"compiled {len(names)} kernels in {time.monotonic() - start:.0f} s")
        else:
            console.say("all kernels are compiled already")
        missing = kernels_to_compile()
    except RuntimeError:
        raise InputError(f"there is no folder to keep compiled kernels in; {CACHE_REMEDY}") from None
    if missing:
        raise InputError(f"{', '.join(missing)}: compiled, but could not be kept; free some disk space, or {CACHE_REMEDY}")


def _lines(finding: Finding, width: int) -> list[str]:
    line = f"{finding.state:8}{finding.name:{width + 2}}{finding.found}"
    return [line, f"{'':{width + 10}}-> {finding.remedy}"] if finding.remedy else [line]
