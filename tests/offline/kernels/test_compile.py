"""Compiling once per machine, and telling who waits."""

import errno
import shutil
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest

from panchroma.offline.numerics import compile as product
from panchroma.offline.numerics.arrays import Ints1
from panchroma.offline.numerics.interpolation import interpolate
from panchroma.shared.arrays import IndexArray
from tests.data import ROOT
from tests.python import run_python

KERNEL = """
from .arrays import Ints1
from .compile import Pieces, parallel_kernel
from .functions import mirrored

@parallel_kernel(pieces=lambda places, size: len(places))
def mirror(pieces: Pieces, places: Ints1, size: int):
    for i in range(*pieces):
        places[i] = mirrored(places[i], size)
"""
SCRIPT = """
import numpy as np
from panchroma.offline.numerics.compile import compilation
from panchroma.offline.numerics.mirror import mirror
with compilation(lambda number, most: print("compiling", number, number <= most)):
    places = np.array([-3, 6])
    mirror(places, 5)
    print(*places)
"""


def copied(folder: Path) -> None:
    """A copy of our packages with one more kernel."""
    for package in ("offline", "shared"):
        shutil.copytree(
            ROOT / package,
            folder / "panchroma" / package,
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    (folder / "panchroma/__init__.py").touch()
    (folder / "panchroma/offline/numerics/mirror.py").write_text(KERNEL)


COMPILED, KEPT = "compiling 1 True\n3 2\n", "3 2\n"


def test_a_kernel_is_compiled_once_until_a_file_of_the_package_changes_or_it_is_kept_badly(
    tmp_path: Path,
) -> None:
    copied(tmp_path)
    assert run_python(SCRIPT, folder=tmp_path) == COMPILED
    assert run_python(SCRIPT, folder=tmp_path) == KEPT
    # from which the kernel takes a function
    helper = tmp_path / "panchroma/offline/numerics/functions.py"
    helper.write_text(helper.read_text() + "# changed\n")
    assert run_python(SCRIPT, folder=tmp_path) == COMPILED
    for path in tmp_path.rglob("mirror*.nb[ic]"):
        path.write_bytes(path.read_bytes()[:-9])
    # compiled without a word, as it seemed to be there
    assert run_python(SCRIPT, folder=tmp_path) == KEPT
    assert run_python(SCRIPT, folder=tmp_path) == COMPILED
    assert run_python(SCRIPT, folder=tmp_path) == KEPT


def more(pieces: product.Pieces, numbers: Ints1, /) -> None:
    for place in range(pieces[0], pieces[1]):
        numbers[place] += 1


@pytest.mark.parametrize(
    "error",
    [RuntimeError("no locator available"), OSError(errno.ENOSPC, "No space left on device")],
)
def test_without_a_place_to_keep_it_a_kernel_is_compiled_all_the_same(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def njit(*signatures: Any, cache: bool = False, **options: Any) -> Any:
        if cache:
            raise error
        return numba.njit(*signatures, **options)

    monkeypatch.setattr(product, "numba", SimpleNamespace(njit=njit))
    made, numbers = product.ParallelKernel(more, len), np.arange(3)
    made(numbers)
    assert numbers.tolist() == [1, 2, 3]


def test_a_kernel_takes_what_it_is_declared_for() -> None:
    values, plane = np.ones((2, 2), np.float32), np.empty((4, 4), np.float32)
    values.flags.writeable = False
    # a whole number for one that need not be
    interpolate(np.ones((2, 2), np.float32), (0.0, 0), 2, plane)
    with pytest.raises(TypeError, match="No matching definition"):
        # nothing is written to it, but that was not declared
        interpolate(values, (0.0, 0.0), 2, plane)


def test_little_work_is_done_by_the_thread_that_asks_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, asking = product.ParallelKernel(more, len), threading.get_ident()
    made(np.arange(3))
    seen: list[tuple[int, bool]] = []

    def work(part: product.Pieces, _: IndexArray) -> None:
        seen.append((part[1] - part[0], threading.get_ident() == asking))

    monkeypatch.setattr(made, "_compiled", work)
    made(np.arange(product.LITTLE))
    assert seen == [(product.LITTLE, True)]
    made(np.arange(4 * product.LITTLE))
    assert sum(size for size, _ in seen[1:]) == 4 * product.LITTLE
    assert len(seen) > 2
