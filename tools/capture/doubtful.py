"""The shots that may be wrong when a stream turns out to have lost bytes: those since the last
frame that was seen to be right.
"""

from pathlib import Path

from ...device.capture import Saved
from ...device.capture.frame_check import SlippedError


class DoubtfulShots:
    """Shots since the last frame that showed its filters where they belong: whatever came before
    that one is right.
    """

    def __init__(self) -> None:
        self._first: Path | None = None
        self._last: Path | None = None
        self._count = 0

    def add(self, shot: Saved) -> None:
        """Count a shot that was saved; where its frame is checked, forget those before it."""
        if shot.is_checked:
            self.clear()
        self._first, self._last, self._count = self._first or shot.path, shot.path, self._count + 1

    def clear(self) -> None:
        """Forget all: a later frame is right."""
        self._first, self._count = None, 0

    def remarks(self, error: Exception) -> list[str]:
        """Advice to the user on the shots before this error ended the stream; empty if there are
        none.
        """
        if self._first is None or not isinstance(error, SlippedError):
            return []
        if self._count == 1:
            return [f"{self._first}: its last rows may be wrong; all shots before it are right"]
        return [
            f"{self._count} shots may be wrong, {self._first} to {self._last}; all before them "
            "are right"
        ]
