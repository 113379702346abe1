"""Check the installation (versions, missing packages, kernels, threads, memory, writing) and say how to repair what is wrong."""

import argparse

from tools.host import options
from tools.host.console import Console
from tools.host.installation import BAD, CHECKS, MISSING, Finding
from tools.host.jobs import FAILED


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma doctor`."""
    options.add_json(parser, "check")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Show what every check finds; returns the exit code: 1 when something is wrong, 0 when something optional is missing."""
    findings = [finding for check in CHECKS for finding in check()]
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        console.say(*_lines(finding, width))
        console.record(check=finding.name, ok=finding.state != BAD, state=finding.state, found=finding.found, remedy=finding.remedy)
    wrong = sum(finding.state == BAD for finding in findings)
    missing = sum(finding.state == MISSING for finding in findings)
    console.say(f"{wrong} wrong, {missing} optional things missing" if wrong or missing else "all is well")
    return FAILED if wrong else 0


def _lines(finding: Finding, width: int) -> list[str]:
    line = f"{finding.state:8}{finding.name:{width + 2}}{finding.found}"
    return [line, f"{'':{width + 10}}-> {finding.remedy}"] if finding.remedy else [line]
