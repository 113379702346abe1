"""Damage files of every kind that Panchroma reads, and read them.

    python -m tests.fuzz --count 20000 --seed 1 [-j 2] [--keep DIR]
    python -m tests.fuzz --number 4711 --seed 1 --keep DIR      repeat one of them and keep its file

Outcomes:
    same     reads as before the damage
    altered  reads as something else, in a format without a digest
    refused  with one line that says why
    FAULT    another exception, a crash, more than 10 s or 300 MB, or a shot that reads as another shot
"""

import sys
from pathlib import Path

from tests.fuzz.campaign import case, run
from tests.fuzz.sweep import arguments, report

if __name__ == "__main__":
    keep = {"type": Path, "metavar": "DIR", "help": "folder for the files that cause faults"}
    given = arguments(__doc__, 1000, keep=keep, jobs=1)
    faults = report(run(given.seed, given.numbers, given.jobs), given)
    if given.keep:
        given.keep.mkdir(parents=True, exist_ok=True)
        for number in faults if given.number is None else given.numbers:
            sample, data = case(given.seed, number)
            (given.keep / f"file-{given.seed}-{number}{sample.suffix}").write_bytes(data)
    sys.exit(bool(faults))
