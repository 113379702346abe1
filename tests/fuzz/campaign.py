"""Read many damaged files in child processes whose time, memory and survival are watched."""

import json
import select
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.data import ROOT
from tests.fuzz.child import FAULT, case
from tests.fuzz.corpus import corpus
from tests.fuzz.sweep import table

CHILD = [sys.executable, "-m", "tests.fuzz.child"]
LIMIT_SECONDS = 10.0
LIMIT_BYTES = 300 * 2**20  # beyond the memory of the program and its libraries
_LOOK = 0.02  # seconds between two checks of a child's memory
_START_SECONDS = 120.0


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

    def add(self, kind: str, number: int, found: dict[str, Any], beyond: int) -> None:
        outcome = found["outcome"]
        self.seconds, self.bytes = max(self.seconds, found["seconds"]), max(self.bytes, beyond)
        if beyond > LIMIT_BYTES:
            outcome, found["why"] = FAULT, f"took {beyond >> 20} MB"
        self.counts[kind, outcome] += 1
        if outcome == FAULT:
            self.faults[number] = found["why"]

    def table(self) -> str:
        """The counts, and the extremes, as lines of text."""
        most = f"slowest {self.seconds:.2f} s, most memory beyond the program's own {self.bytes >> 20} MB"
        return f"{table(self.counts)}\n{most}"


def run(seed: int, numbers: Sequence[int], jobs: int = 1, keep: Path | None = None) -> Campaign:
    """Read the files with these numbers, `jobs` at a time. Files that cause faults are kept in the folder `keep`."""
    campaign = Campaign()
    samples = corpus()
    shares = [numbers[start::jobs] for start in range(jobs)]
    with ThreadPoolExecutor(jobs) as pool:
        for outcomes in pool.map(lambda share: list(_read(seed, share)), shares):
            for number, found, beyond in outcomes:
                campaign.add(samples[number % len(samples)].kind, number, found, beyond)
    for number in campaign.faults if keep else ():
        sample, data = case(samples, seed, number)
        (keep / f"fault-{seed}-{number}{sample.suffix}").write_bytes(data)
    return campaign


def _read(seed: int, numbers: Sequence[int]) -> Iterator[tuple[int, dict[str, Any], int]]:
    """Yield (number, outcome, bytes beyond the program's own) for each file. A child that does not answer is replaced."""
    child = _Child()
    for number in numbers:
        found, beyond = child.ask(seed, number)
        yield number, found, beyond
        if not child.usable or beyond > LIMIT_BYTES:
            child.end()
            child = _Child()
    child.end()


class _Child:
    def __init__(self) -> None:
        self._process = subprocess.Popen(CHILD, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self._own = 0
        self._own = self._answer(_START_SECONDS)["bytes"]
        self.usable = True

    def ask(self, seed: int, number: int) -> tuple[dict[str, Any], int]:
        try:
            self._process.stdin.write(f"{seed} {number}\n".encode())
            self._process.stdin.flush()
            found = self._answer(LIMIT_SECONDS)
        except (OSError, TimeoutError, MemoryError, EOFError) as error:
            self.usable = False
            code = self._process.poll()
            why = f"{error}" if code is None else f"ended with {code}"
            return {"outcome": FAULT, "why": f"the process that read it {why}", "seconds": 0.0}, 0
        return found, found["bytes"] - self._own

    def end(self) -> None:
        self._process.kill()
        self._process.communicate()

    def _answer(self, seconds: float) -> dict[str, Any]:
        """The next line. Raises TimeoutError, MemoryError, or EOFError when the process has died."""
        until = time.monotonic() + seconds
        while not select.select([self._process.stdout], [], [], _LOOK)[0]:
            if time.monotonic() > until:
                raise TimeoutError(f"did not answer for {seconds:g} s")
            if self._own and (beyond := self._resident() - self._own) > LIMIT_BYTES:
                raise MemoryError(f"took {beyond >> 20} MB")
        line = self._process.stdout.readline()
        if not line:
            self._process.wait(1)
            raise EOFError
        return json.loads(line)

    def _resident(self) -> int:
        try:
            status = Path(f"/proc/{self._process.pid}/status").read_text("ascii")
        except OSError:
            return 0
        return next((int(line.split()[1]) * 1024 for line in status.splitlines() if line.startswith("VmRSS")), 0)
