"""How much of a long piece of work is done, and how long the rest will take."""

import time


class Countdown:
    """Counts finished pieces of work whose relative lengths are known.

    total: sum of the lengths, in any unit.
    count: number of pieces.
    """

    def __init__(self, total: float, count: int) -> None:
        self._total, self._count = total, count
        self._done, self._finished = 0.0, 0
        self._start = time.monotonic()

    def finished(self, length: float) -> None:
        """Count a piece of this length as done."""
        self._done += length
        self._finished += 1

    @property
    def fraction(self) -> float:
        """The part of the work that is done, 0 to 1."""
        return min(self._done / self._total, 1.0) if self._total else 1.0

    def __str__(self) -> str:
        """For example "12 of 40 done, about 3 min left"."""
        said = f"{self._finished} of {self._count} done"
        if not self._finished or self._finished == self._count or not self._done:
            return said
        left = (time.monotonic() - self._start) * (1 - self.fraction) / self.fraction
        return f"{said}, about {duration(left)} left"


def duration(seconds: float) -> str:
    """A time for people: "40 s", "12 min", "3 h 20 min"."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02} min"
