"""Read many damaged files in worker processes, so that a file that crashes, hangs or swells one
ends nothing else.
"""

import multiprocessing
import os
import resource
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from pebble import ProcessExpired, ProcessPool

from panchroma.shared.errors import InputError
from tests.fuzz.corpus import Sample, corpus
from tests.fuzz.mutations import mutated
from tests.fuzz.sweep import table

SAME, ALTERED, REFUSED, FAULT = "same", "altered", "refused", "FAULT"
LIMIT_SECONDS = 10.0
LIMIT_BYTES = 300 * 2**20  # beyond the memory of the program and its libraries
_SPARE = 4 << 30  # bytes beyond that memory which a worker may ask for: the machine must survive
Outcome = tuple[str, str]
"""One of the four above, and the reason."""


@dataclass
class Campaign:
    """The results.

    counts: files by (kind, outcome).
    faults: number of the file -> what happened.
    seconds: the longest time for one file.
    bytes: the most memory for one file.
    """

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    faults: dict[int, str] = field(default_factory=dict)
    seconds: float = 0.0
    bytes: int = 0

    def table(self) -> str:
        """The counts, and the extremes, as lines of text."""
        memory = f"most memory beyond the program's own {self.bytes >> 20} MB"
        return f"{table(self.counts)}\nslowest {self.seconds:.2f} s, {memory}"


def run(seed: int, numbers: Sequence[int], jobs: int = 1, keep: Path | None = None) -> Campaign:
    """Read the files with these numbers, `jobs` at a time. Files that cause faults are kept in the
    folder `keep`.
    """
    campaign, samples, context = Campaign(), corpus(), multiprocessing.get_context("spawn")
    with ProcessPool(jobs, initializer=_prepare, context=context) as pool:
        readings = {
            number: pool.schedule(_read, args=[seed, number], timeout=LIMIT_SECONDS)
            for number in numbers
        }
        for number, reading in readings.items():
            sample, data = case(samples, seed, number)
            outcome, seconds, size = FAULT, 0.0, 0
            try:
                (outcome, why), seconds, size = reading.result()
            except TimeoutError:
                why, seconds = f"did not end within {LIMIT_SECONDS:g} s", LIMIT_SECONDS
            except ProcessExpired as error:
                why = f"the process that read it ended with {error.exitcode}"
            if size > LIMIT_BYTES:
                outcome, why = FAULT, f"took {size >> 20} MB"
            campaign.counts[sample.kind, outcome] += 1
            campaign.seconds = max(campaign.seconds, seconds)
            campaign.bytes = max(campaign.bytes, size)
            if outcome == FAULT:
                campaign.faults[number] = why
                if keep:
                    (keep / f"fault-{seed}-{number}{sample.suffix}").write_bytes(data)
    return campaign


def case(samples: list[Sample], seed: int, number: int) -> tuple[Sample, bytes]:
    """The sample and its damaged bytes. They depend on nothing but seed and number."""
    random = np.random.default_rng([seed, number])
    sample = samples[number % len(samples)]
    others = [other.data for other in samples if other.kind == sample.kind]
    return sample, mutated(sample.data, random, others)


def _prepare() -> None:
    """Get a worker ready: libraries loaded, what they print thrown away, memory limited."""
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    _originals()
    resource.setrlimit(resource.RLIMIT_DATA, (_memory("VmData") + _SPARE, resource.RLIM_INFINITY))


@cache
def _originals() -> tuple[list[Sample], dict[bytes, object]]:
    """The samples, and what each reads as, by its bytes."""
    samples = corpus()
    with tempfile.TemporaryDirectory() as folder:
        originals = {}
        for sample in samples:
            path = Path(folder) / f"original{sample.suffix}"
            path.write_bytes(sample.data)
            originals[sample.data] = sample.read(path)
    return samples, originals


def _read(seed: int, number: int) -> tuple[Outcome, float, int]:
    """In a worker: the outcome of reading a damaged file, the seconds, and the bytes beyond those
    that it had before.
    """
    samples, originals = _originals()
    sample, data = case(samples, seed, number)
    # A splice may have made another whole sample, but for bytes that say nothing of its content.
    expected = [originals[other.data] for other in samples if other.kind == sample.kind]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"shot{sample.suffix}"
        path.write_bytes(data)
        Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
        before, start = _memory("VmHWM"), time.perf_counter()
        outcome = _outcome(sample, expected, path)
        return outcome, time.perf_counter() - start, _memory("VmHWM") - before


def _outcome(sample: Sample, originals: list[object], path: Path) -> Outcome:
    """Outcome of reading the file at `path`. A sealed file that reads as something else than one of
    `originals` is a fault.
    """
    try:
        content = sample.read(path)
    except InputError as error:
        return REFUSED, str(error)
    except BaseException as error:
        return FAULT, "".join(traceback.format_exception(error))
    if any(content == original for original in originals):
        return SAME, ""
    if sample.sealed:
        return FAULT, "silently wrong: accepted, and not what was written"
    return ALTERED, ""


def _memory(figure: str) -> int:
    """Bytes of this process: VmHWM, its peak, or VmData, what it has asked for."""
    lines = Path("/proc/self/status").read_text("ascii").splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{figure}:"))
