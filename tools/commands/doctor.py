"""Check the installation (versions, missing packages, kernels, memory, writing) and say how to repair what is wrong.

With --compile, compile the renderer for this processor first, so that no render has to: for container images and clusters.
"""

import argparse
import time

from shared.processors import processors
from tools.host.console import Console
from tools.host.jobs import FAILED
from tools.rendering.compilation import CACHE_REMEDY, compile_all, to_compile

from .checks import ALL, BAD, CHECKS, GOOD, MISSING, Finding
from .options import add, option


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma doctor`."""
    option(
        parser,
        "--compile",
        "first compile all of the renderer that is not compiled yet; what is compiled serves this version of Panchroma on "
        "processors of this model, wherever it finds the same cache folder (the line 'kernel cache' names it)",
    )
    add(parser, "json", each="check")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Show what every check finds; returns the exit code: 1 when something is wrong, 0 when something optional is missing."""
    findings = [_compiled(console)] if arguments.compile else []
    findings += [finding for check in CHECKS for finding in check()]
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        console.say(*_lines(finding, width))
        console.record(check=finding.name, ok=finding.state != BAD, state=finding.state, found=finding.found, remedy=finding.remedy)
    wrong = sum(finding.state == BAD for finding in findings)
    missing = sum(finding.state == MISSING for finding in findings)
    console.say(f"{wrong} wrong, {missing} optional things missing" if wrong or missing else "all is well")
    return FAILED if wrong else 0


def _compiled(console: Console) -> Finding:
    """Compile all kernels that are not in the cache."""
    name = "compilation"
    try:
        names = to_compile()
        start = time.monotonic()
        with console.progress("doctor") as progress:
            progress.stage("compiling", len(names))
            for number, (kernel, error) in enumerate(compile_all(names, processors(), console.note), 1):
                if error is not None:
                    return Finding(name, BAD, f"{kernel}: {error}", "close other programs, and run it again")
                progress.advance()
                progress.remark(f"compiled kernel {number} of {len(names)}")
        if missing := to_compile():
            return Finding(name, BAD, f"could not keep {', '.join(missing)}", f"free some disk space, or {CACHE_REMEDY}")
    except ModuleNotFoundError as error:
        return Finding(name, BAD, f"needs {error.name}, which is not installed", ALL)
    except RuntimeError:
        return Finding(name, BAD, "there is no folder to keep compiled kernels in", CACHE_REMEDY)
    took = f"{len(names)} kernels in {time.monotonic() - start:.0f} s" if names else "all kernels were compiled already"
    return Finding(name, GOOD, took)


def _lines(finding: Finding, width: int) -> list[str]:
    line = f"{finding.state:8}{finding.name:{width + 2}}{finding.found}"
    return [line, f"{'':{width + 10}}-> {finding.remedy}"] if finding.remedy else [line]
