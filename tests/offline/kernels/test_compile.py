"""Compiling once per machine, and telling who waits."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from offline.kernels import compile as product
from tests.data import ROOT
from tests.python import run_python

SCRIPT = """
import numpy as np
from offline.kernels.compile import compilation
from offline.kernels.functions import mirrored
with compilation(lambda number, most: print("compiling", number)):
    print(mirrored(-3, 5))
"""


def test_a_kernel_is_compiled_once_until_any_of_them_changes(tmp_path: Path) -> None:
    for package in ("offline", "shared"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    assert run_python(SCRIPT, folder=tmp_path) == "compiling 1\n3\n"
    assert run_python(SCRIPT, folder=tmp_path) == "3\n"
    lanes = tmp_path / "offline/kernels/lanes.py"  # which the kernel's own file imports
    lanes.write_text(lanes.read_text() + "# changed\n")
    assert run_python(SCRIPT, folder=tmp_path) == "compiling 1\n3\n"


IN_TURN = """
import numpy as np
from offline.kernels.compile import compilation, kernel, parallel_kernel

@kernel
def part(x):
    return x + 1

@parallel_kernel
def first(x):
    return part(x)

@parallel_kernel
def second(x):
    return np.sort(part(x))

@parallel_kernel
def never(x):
    return x

with compilation(lambda number, most: print(number, number <= most)):
    for function in (first, second, first):
        function(np.ones(3))
"""


def test_kernels_are_counted_and_their_parts_are_not(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(IN_TURN)
    assert run_python(f"exec(compile(open({str(tmp_path / 'script.py')!r}).read(), {str(tmp_path / 'script.py')!r}, 'exec'))") == (
        "1 True\n2 True\n"
    )


def test_threads_are_what_was_asked_for(each_thread_count: Iterator[int]) -> None:
    for count in each_thread_count:
        assert product.threads() == count
    with pytest.raises(ValueError, match="number of threads"):
        product.use_threads(product.available_threads() + 1)
