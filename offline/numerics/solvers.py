"""Statistics of the iterative solvers of a rendering."""

from dataclasses import dataclass

from ...shared.arrays import DoubleArray, IndexArray
from ...shared.errors import ConvergenceError
from ...shared.progress import SILENT, Progress


@dataclass(frozen=True)
class Solved:
    """Statistics of an iterative solver; of several systems the worst case.

    Attributes
    ----------
    iterations : int
        How many it used.
    residual : float
        What was left after them, 0 or more. What it measures depends on the solver: see
        `Rendering.solvers`.

    Examples
    --------
    >>> from panchroma.offline import Solved
    >>> Solved(iterations=41, residual=9.7e-4).iterations
    41
    """

    iterations: int
    residual: float


class SolverLog(Progress):
    """A progress listener that keeps what the solvers did, and passes everything on to another
    listener.

    solvers: what each solver did so far, by its name (see `Rendering.solvers`).

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> mosaic = Mosaic(np.ones((24, 24), np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> from panchroma.offline import PAPER, SolverLog, render_bands
    >>> log = SolverLog()
    >>> rows = sum(len(band) for band in render_bands(mosaic, PAPER, log))
    >>> log.solvers["luminance"].iterations
    50
    """

    def __init__(self, progress: Progress = SILENT) -> None:
        self.solvers: dict[str, Solved] = {}
        self._progress = progress

    def stage(self, name: str, steps: int) -> None:
        """Pass the report on to the other listener."""
        self._progress.stage(name, steps)

    def advance(self, steps: int = 1) -> None:
        """Pass the report on to the other listener."""
        self._progress.advance(steps)

    def part(self, name: str) -> None:
        """Pass the report on to the other listener."""
        self._progress.part(name)

    def solved(self, solver: str, iterations: int, residual: float) -> None:
        """Keep the worst of what this solver reported, and pass it on."""
        before = self.solvers.get(solver, Solved(0, 0.0))
        self.solvers[solver] = Solved(
            max(iterations, before.iterations), max(residual, before.residual)
        )
        self._progress.solved(solver, iterations, residual)


def report(
    progress: Progress, solver: str, used: IndexArray, residuals: DoubleArray, tolerance: float
) -> None:
    """Report the worst of several systems that conjugate gradients solved.

    Parameters
    ----------
    solver : str
        Its name.
    used, residuals : IndexArray, DoubleArray
        (systems,), iterations and relative residual of each, one or more.
    tolerance : float
        Residual at which they were to stop. Raises ConvergenceError if one did not get there.
    """
    worst = float(residuals.max())
    progress.solved(solver, int(used.max()), worst)
    if not worst <= tolerance:
        raise ConvergenceError(
            f"{solver}: conjugate gradients stopped at a relative residual of {worst:.1e} after "
            f"{used.max()} iterations, short of {tolerance:.1e}"
        )
