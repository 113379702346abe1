"""How long work reports where it is, without knowing whether anybody looks."""

from typing import Protocol


class Progress(Protocol):
    """A listener: told which stage begins and how many steps it has, then of every step done.

    Implementations show it (a bar, a line) or count it (tests); they must be cheap, for `advance` is called from inner loops.
    """

    def stage(self, name: str, steps: int) -> None:
        """A stage begins; the one before it has ended."""

    def advance(self, steps: int = 1) -> None:
        """So many more steps of the current stage are done."""


class Silent:
    """Nobody looks."""

    def stage(self, name: str, steps: int) -> None:
        """Ignore it."""

    def advance(self, steps: int = 1) -> None:
        """Ignore it."""


SILENT: Progress = Silent()
