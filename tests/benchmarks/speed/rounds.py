"""Compare the speed of several functions by running them in turns, so that other load on the machine affects all alike."""

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from shared.progress import Progress

Work = Callable[[], object]


@dataclass(frozen=True)
class Timing:
    """How long one function took.

    seconds: its time in each round.
    pixels: size of the picture it worked on.
    """

    seconds: tuple[float, ...]
    pixels: int

    @property
    def speed(self) -> tuple[float, float, float]:
        """Megapixels per second: the least, the median and the most of all rounds."""
        speeds = [self.pixels / 1e6 / seconds for seconds in self.seconds]
        return min(speeds), statistics.median(speeds), max(speeds)

    def times_as_fast_as(self, other: "Timing") -> float:
        """The median over the rounds of (time of `other`) / (own time): load that slows a whole round down cancels."""
        return statistics.median(theirs / ours for ours, theirs in zip(self.seconds, other.seconds, strict=True))


def alternate(works: Mapping[str, Work], rounds: int, done: Callable[[], None]) -> dict[str, tuple[float, ...]]:
    """Time functions in turns. Returns the seconds of each in each round.

    The first round is not timed. Every other round runs backwards, so that no function always follows the same one.

    works: the functions, by name.
    rounds: how many rounds are timed.
    done: called after each function.
    """
    found: dict[str, list[float]] = {name: [] for name in works}
    order = list(works.items())
    for number in range(rounds + 1):
        for name, work in order:
            start = time.perf_counter()
            result = work()
            seconds = time.perf_counter() - start
            del result  # freeing its memory is not timed
            if number:
                found[name].append(seconds)
            done()
        order.reverse()
    return {name: tuple(seconds) for name, seconds in found.items()}


class StageClock(Progress):
    """A progress listener that measures how long each stage of a rendering takes, or each part of a stage that has parts."""

    def __init__(self) -> None:
        self.runs: list[dict[str, float]] = []
        self._stage, self._name, self._since = "", "", 0.0

    def stage(self, name: str, steps: int) -> None:
        """A stage begins; the stage before it has ended."""
        self._end()
        self._stage = self._name = name

    def part(self, name: str) -> None:
        """A part of a step begins. Its times in all steps are added up; the first part includes the beginning of its stage."""
        if self._name != self._stage:
            self._end()
        self._name = name

    def run(self, work: Work) -> object:
        """Call `work`, a rendering that reports to this listener, and return its result."""
        self.runs.append({})
        result = work()
        self._end()
        self._stage = self._name = ""
        return result

    def seconds(self, rounds: int) -> dict[str, tuple[float, ...]]:
        """Seconds of each stage or part in each of the last `rounds` runs."""
        return {name: tuple(run[name] for run in self.runs[-rounds:]) for name in self.runs[-1]}

    def _end(self) -> None:
        now = time.perf_counter()
        if self._name:
            run = self.runs[-1]
            run[self._name] = run.get(self._name, 0.0) + now - self._since
        self._since = now
