"""How long computations report their progress, to whoever listens or to nobody."""

from typing import Protocol


class Progress(Protocol):
    """A listener: `stage` is called when a stage begins, `advance` when steps of it are done.

    Implementations show it (a bar, a line) or count it (tests). They must be cheap, because `advance` is called from inner loops.
    """

    def stage(self, name: str, steps: int) -> None:
        """A stage of `steps` steps begins; the one before it has ended."""

    def advance(self, steps: int = 1) -> None:
        """Another `steps` steps of the current stage are done."""


class Silent:
    """A listener that ignores everything."""

    def stage(self, name: str, steps: int) -> None:
        """Ignore it."""

    def advance(self, steps: int = 1) -> None:
        """Ignore it."""


SILENT: Progress = Silent()
