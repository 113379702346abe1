"""Print the script that lets a shell complete verbs, options, and names of files.

bash: put the line eval "$(panchroma completion bash)" into ~/.bashrc. zsh: save the script as
_panchroma in a folder of $fpath. fish: see the example.
"""

import argparse
from pathlib import Path
from typing import Any

from ..batch.console import Console, to_stdout
from .options import file_name

USAGE = "SHELL"
EXAMPLE = "panchroma completion fish > ~/.config/fish/completions/panchroma.fish"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma completion`."""
    shells = "bash", "zsh", "fish"
    parser.add_argument("shell", choices=shells, metavar="SHELL", help=" or ".join(shells))


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Print the script; returns the exit code."""
    import shtab

    from ..cli import VERBS, build_parser

    class Store(argparse.Action):
        """Takes names of files, unless it takes something else."""

        def __init__(self, *names: Any, **settings: Any) -> None:
            super().__init__(*names, **settings)
            if self.choices is None and self.type in (None, Path, file_name):
                self.complete = shtab.FILE

    parser, _ = build_parser(*VERBS, store=Store)
    to_stdout(shtab.complete(parser, arguments.shell))
    return 0
