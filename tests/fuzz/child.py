"""The child process that reads damaged files, so that a crash ends nothing else. Numbers come in, outcomes go out."""

import json
import resource
import sys
import tempfile
import time
import traceback
from pathlib import Path

import numpy as np

from panchroma.shared.errors import InputError
from tests.fuzz.corpus import Sample, corpus
from tests.fuzz.mutations import mutated

SAME, ALTERED, REFUSED, FAULT = "same", "altered", "refused", "FAULT"


def case(samples: list[Sample], seed: int, number: int) -> tuple[Sample, bytes]:
    """The sample and its damaged bytes. They depend on nothing but seed and number."""
    random = np.random.default_rng([seed, number])
    sample = samples[number % len(samples)]
    others = [each.data for each in samples if each.kind == sample.kind]
    return sample, mutated(sample.data, random, others)


def outcome(sample: Sample, original: bytes, path: Path) -> tuple[str, str]:
    """(outcome, reason) of reading the file at `path`. A sealed file that reads as something else than `original` is a fault."""
    try:
        read = sample.read(path)
    except InputError as error:
        return REFUSED, str(error)
    except BaseException as error:
        return FAULT, "".join(traceback.format_exception(error))
    if read == original:
        return SAME, ""
    return (FAULT, "silently wrong: accepted, and not what was written") if sample.sealed else (ALTERED, "")


def undamaged(samples: list[Sample], data: bytes, index: int) -> int:
    """Which sample the bytes should read as: the one they were made of, unless a splice has made them another whole sample."""
    return next((each for each, sample in enumerate(samples) if sample.data == data), index)


def main() -> None:
    """Read lines "SEED NUMBER" and answer each with a line of JSON; the first line says that the process is ready."""
    samples = corpus()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        originals = []
        for sample in samples:
            path = place / f"original{sample.suffix}"
            path.write_bytes(sample.data)
            originals.append(sample.read(path))
        say = sys.stdout
        sys.stdout = sys.stderr  # a library may print, which must not look like an outcome
        print(json.dumps({"ready": [sample.kind for sample in samples], "bytes": _peak()}), file=say, flush=True)
        for line in sys.stdin:
            seed, number = map(int, line.split())
            sample, data = case(samples, seed, number)
            path = place / f"shot{sample.suffix}"
            path.write_bytes(data)
            start = time.perf_counter()
            found, why = outcome(sample, originals[undamaged(samples, data, number % len(samples))], path)
            answer = {"outcome": found, "why": why, "seconds": time.perf_counter() - start, "bytes": _peak()}
            print(json.dumps(answer), file=say, flush=True)


def _peak() -> int:
    """Peak memory of this process, bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


if __name__ == "__main__":
    main()
