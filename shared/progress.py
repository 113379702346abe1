"""Progress reports of long-running work, independent of who listens."""


class Progress:
    """A listener to long-running work. Every method does nothing here: override those that matter
    to you.

    Methods must be cheap: they are called from inner loops.
    """

    def stage(self, name: str, steps: int) -> None:
        """A stage of `steps` steps begins; the stage before it has ended."""

    def advance(self, steps: int = 1) -> None:
        """`steps` more steps of the current stage are done."""

    def substep(self, name: str) -> None:
        """A substep of the current step begins; the substep before it has ended. Stages whose
        steps have no substeps never call this.
        """


SILENT = Progress()
"""A listener that ignores everything."""
