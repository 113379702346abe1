"""How far long work is, and the time it still needs."""

import time


class Countdown:
    """Of work whose pieces have known relative lengths. total: the sum of them, in any unit; count: how many there are."""

    def __init__(self, total: float, count: int) -> None:
        self._total, self._count = total, count
        self._done, self._finished = 0.0, 0
        self._start = time.monotonic()

    def finished(self, length: float) -> None:
        """A piece of that length is done."""
        self._done += length
        self._finished += 1

    @property
    def fraction(self) -> float:
        """Of the work that is done, 0 to 1."""
        return min(self._done / self._total, 1.0) if self._total else 1.0

    def __str__(self) -> str:
        """For example "12 of 40 done, about 3 min left"."""
        said = f"{self._finished} of {self._count} done"
        if not self._finished or self._finished == self._count or not self._done:
            return said
        left = (time.monotonic() - self._start) * (1 - self.fraction) / self.fraction
        return f"{said}, about {duration(left)} left"


def duration(seconds: float) -> str:
    """For people: "40 s", "12 min", "3 h 20 min"."""
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02} min"
