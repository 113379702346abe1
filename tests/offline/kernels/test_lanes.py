"""Functions of lanes and numbers: each does what NumPy does, as exactly as it promises."""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from panchroma.offline.numerics import functions
from panchroma.offline.numerics.lanes import WIDTH, load, store
from panchroma.shared.arrays import FloatArray

# What the docstrings of the approximations promise.
APPROXIMATE = 1e-6
# Python can call what it compiles, with arguments of any type.
callable_kernel: Callable[..., Any] = numba.njit(fastmath={"contract"}, error_model="numpy")


@callable_kernel
def root_of(values: FloatArray, scale: float, out: FloatArray) -> None:
    for place in range(0, len(values), WIDTH):
        store(out, place, functions.scaled_reciprocal_root(load(values, place), np.float32(scale)))


def test_reciprocal_root() -> None:
    wide, narrow = np.logspace(-36, 36, 16 * 2000), np.linspace(1, 4, 16 * 2000)
    values = np.concatenate([wide, narrow]).astype(np.float32)
    found = np.empty_like(values)
    root_of(values, 0.3, found)
    assert np.abs(found * np.sqrt(values.astype(np.float64)) / 0.3 - 1).max() < APPROXIMATE
    root_of(np.zeros(WIDTH, np.float32), 1e-6, found[:WIDTH])
    assert np.isfinite(found[:WIDTH]).all()
    assert found[0] > 1e10


@callable_kernel
def exponential_of(values: FloatArray, out: FloatArray) -> None:
    for place in range(len(values)):
        out[place] = functions.exponential(values[place])


def test_exponential() -> None:
    wide, near = np.linspace(-87, 0, 16 * 4000), -np.logspace(-30, 1, 16 * 1000)
    values = np.concatenate([wide, near]).astype(np.float32)
    found = np.empty_like(values)
    exponential_of(values, found)
    assert np.abs(found / np.exp(values.astype(np.float64)) - 1).max() < APPROXIMATE
    far = np.array([0.0, -87, -87.1, -200, -1e6, -1e30, -3e38, -np.inf] * 2, np.float32)
    exponential_of(far, found[:WIDTH])
    assert found[0] == 1
    assert (found[2:8] == found[1]).all()
    assert found[1] > 0
