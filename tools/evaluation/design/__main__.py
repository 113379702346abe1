"""Measure what photographs are like, for `panchroma design`: `python -m tools.evaluation.design FOLDER -o FILE`."""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from shared.arrays import DoubleArray
from shared.errors import PanchromaError
from shared.progress import Progress
from shared.writing import write_durably
from tools.host.console import Console
from tools.scenes.load import ENDINGS, load_scene

from .spectra import Spectra


def _pictures(sources: list[Path], progress: Progress) -> Iterator[DoubleArray]:
    for source in sources:
        yield load_scene(str(source)).rgb.astype(np.float64)
        progress.advance()


def main() -> int:
    """Measure; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.evaluation.design", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="photographs to learn from, in this folder or below")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FILE", help="for the table: spectra.json")
    arguments = parser.parse_args()
    console = Console()
    try:
        sources = [path for path in sorted(arguments.folder.rglob("*")) if path.suffix.lower() in ENDINGS]
        with console.progress("photographs") as progress:
            progress.stage("measuring", len(sources))
            spectra = Spectra.measured(_pictures(sources, progress))
        write_durably(arguments.output, (spectra.encode() + "\n").encode(), overwrite=True)
    except PanchromaError as error:
        console.error(str(error))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
