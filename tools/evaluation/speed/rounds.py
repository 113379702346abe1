"""Timing several things against each other: in turns, so that whatever else the machine does meets all of them alike."""

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

Work = Callable[[], object]


@dataclass(frozen=True)
class Timing:
    """What one thing took, round by round, seconds, for a picture of `pixels` pixels."""

    seconds: tuple[float, ...]
    pixels: int

    @property
    def speed(self) -> tuple[float, float, float]:
        """Megapixels a second: the least, the median, the most."""
        speeds = [self.pixels / 1e6 / seconds for seconds in self.seconds]
        return min(speeds), statistics.median(speeds), max(speeds)

    def times_as_fast_as(self, other: "Timing") -> float:
        """The median of the rounds' ratios: what slows a whole round down is in both halves of one."""
        return statistics.median(theirs / ours for ours, theirs in zip(self.seconds, other.seconds, strict=True))


def alternate(works: Mapping[str, Work], rounds: int, done: Callable[[], None]) -> dict[str, tuple[float, ...]]:
    """Seconds of each work in each of `rounds` rounds, after one that is not timed.

    Every other round goes backwards, so that none always follows the same one. done: called after each piece of work.
    """
    found: dict[str, list[float]] = {name: [] for name in works}
    order = list(works.items())
    for number in range(rounds + 1):
        for name, work in order:
            start = time.perf_counter()
            result = work()
            seconds = time.perf_counter() - start
            del result  # giving its memory back is not timed
            if number:
                found[name].append(seconds)
            done()
        order.reverse()
    return {name: tuple(seconds) for name, seconds in found.items()}


class StageClock:
    """A listener to a rendering that notes how long each of its stages takes, one run after the other."""

    def __init__(self) -> None:
        self.runs: list[dict[str, float]] = []
        self._name, self._since = "", 0.0

    def stage(self, name: str, steps: int) -> None:
        """A stage begins; the one before it has ended."""
        self._end()
        self._name, self._since = name, time.perf_counter()

    def advance(self, steps: int = 1) -> None:
        """Not asked."""

    def run(self, work: Work) -> object:
        """Do the work, which tells this listener its stages."""
        self.runs.append({})
        result = work()
        self._end()
        self._name = ""
        return result

    def seconds(self, rounds: int) -> dict[str, tuple[float, ...]]:
        """Of each stage, in the last `rounds` runs."""
        return {name: tuple(run[name] for run in self.runs[-rounds:]) for name in self.runs[-1]}

    def _end(self) -> None:
        if self._name:
            self.runs[-1][self._name] = time.perf_counter() - self._since
