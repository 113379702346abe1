"""Read many damaged files in worker processes, so that a file that crashes, hangs or swells one
ends nothing else.
"""

import multiprocessing
import os
import resource
import tempfile
import traceback
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from pebble import ProcessExpired, ProcessPool

from panchroma.shared.errors import InputError
from tests.benchmarks.harness import memory
from tests.fuzz.corpus import Sample, corpus
from tests.fuzz.mutations import mutated
from tests.fuzz.sweep import FAULT, Result

SAME, ALTERED, REFUSED = "same", "altered", "refused"
LIMIT_SECONDS = 10.0
LIMIT_BYTES = 300 * 2**20  # beyond the memory of the program and its libraries
_SPARE = 4 << 30  # bytes beyond that memory which a worker may ask for: the machine must survive


def run(seed: int, numbers: Sequence[int], jobs: int = 1) -> Iterator[Result]:
    """Read the files with these numbers, `jobs` at a time."""
    context = multiprocessing.get_context("spawn")
    with ProcessPool(jobs, initializer=_prepare, context=context) as pool:
        readings = [
            pool.schedule(_read, args=[seed, number], timeout=LIMIT_SECONDS) for number in numbers
        ]
        for number, reading in zip(numbers, readings, strict=True):
            try:
                yield reading.result()
                continue
            except TimeoutError:
                why = f"did not end within {LIMIT_SECONDS:g} s"
            except ProcessExpired as error:
                why = f"the process that read it ended with {error.exitcode}"
            yield Result(number, case(seed, number)[0].kind, FAULT, why)


def case(seed: int, number: int) -> tuple[Sample, bytes]:
    """The sample and its damaged bytes. They depend on nothing but seed and number."""
    random, samples = np.random.default_rng([seed, number]), corpus()
    sample = samples[number % len(samples)]
    others = [other.data for other in samples if other.kind == sample.kind]
    return sample, mutated(sample.data, random, others)


def _prepare() -> None:
    """Get a worker ready: libraries loaded, what they print thrown away, memory limited."""
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    _originals()
    resource.setrlimit(resource.RLIMIT_DATA, (memory("VmData") + _SPARE, resource.RLIM_INFINITY))


@cache
def _originals() -> dict[bytes, object]:
    """What each sample reads as, by its bytes."""
    with tempfile.TemporaryDirectory() as folder:
        originals = {}
        for sample in corpus():
            path = Path(folder) / f"original{sample.suffix}"
            path.write_bytes(sample.data)
            originals[sample.data] = sample.read(path)
    return originals


def _read(seed: int, number: int) -> Result:
    """In a worker: the outcome of reading a damaged file."""
    sample, data = case(seed, number)
    # A splice may have made another whole sample, but for bytes that say nothing of its content.
    expected = [_originals()[other.data] for other in corpus() if other.kind == sample.kind]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"shot{sample.suffix}"
        path.write_bytes(data)
        Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
        before = memory("VmHWM")
        outcome, why = _outcome(sample, expected, path)
        size = memory("VmHWM") - before
    if size > LIMIT_BYTES:
        outcome, why = FAULT, f"took {size >> 20} MB"
    return Result(number, sample.kind, outcome, why)


def _outcome(sample: Sample, originals: list[object], path: Path) -> tuple[str, str]:
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
