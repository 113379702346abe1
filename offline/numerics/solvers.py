"""The check of what iterative solvers reached."""

from ...shared.arrays import DoubleArray, IndexArray
from ...shared.errors import ConvergenceError


def check_convergence(
    solver: str, used: IndexArray, residuals: DoubleArray, tolerance: float
) -> None:
    """Raise ConvergenceError if conjugate gradients did not reach their tolerance in one of several
    systems.

    Parameters
    ----------
    solver : str
        Its name.
    used, residuals : IndexArray, DoubleArray
        (systems,), iterations and relative residual of each, one or more.
    tolerance : float
        Residual at which they were to stop.
    """
    worst = float(residuals.max())
    if not worst <= tolerance:
        raise ConvergenceError(
            f"{solver}: conjugate gradients stopped at a relative residual of {worst:.1e} after "
            f"{used.max()} iterations, short of {tolerance:.1e}"
        )
