"""Kernels and their callees in a form that tests can call from Python."""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def callable_kernel(function: F) -> F:
    """A function, or a callee of kernels, compiled so that Python can call it, with arguments of
    any type.
    """
    source = getattr(function, "py_func", function)
    return numba.njit(fastmath={"contract"}, error_model="numpy")(source)
