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
from tests.fuzz.corpus import corpus
from tests.fuzz.sweep import numbers, options


def main() -> int:
    parser = options(__doc__, 1000)
    keep = "folder for the files that cause faults"
    parser.add_argument("--keep", type=Path, metavar="DIR", help=keep)
    parser.add_argument("-j", "--jobs", type=int, default=1, metavar="N", help="processes")
    arguments = parser.parse_args()
    if arguments.keep:
        arguments.keep.mkdir(parents=True, exist_ok=True)
    if arguments.number is not None and arguments.keep:
        sample, data = case(corpus(), arguments.seed, arguments.number)
        name = f"file-{arguments.seed}-{arguments.number}{sample.suffix}"
        (arguments.keep / name).write_bytes(data)
    campaign = run(arguments.seed, numbers(arguments), arguments.jobs, arguments.keep)
    for number, why in sorted(campaign.faults.items()):
        print(f"seed {arguments.seed} number {number}: {why.strip()}", file=sys.stderr)
    print(campaign.table())
    return 1 if campaign.faults else 0


if __name__ == "__main__":
    sys.exit(main())
