"""Compiling once per machine, and telling who waits."""

import errno
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from numba.core.caching import CacheImpl, IndexDataCacheFile

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


@pytest.mark.parametrize("damaged", ["nbi", "nbc"])
def test_a_kernel_that_was_kept_badly_is_compiled_again(tmp_path: Path, damaged: str) -> None:
    for package in ("offline", "shared"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    run_python(SCRIPT, folder=tmp_path)
    for path in tmp_path.rglob(f"*.{damaged}"):
        path.write_bytes(path.read_bytes()[:-9])
    assert run_python(SCRIPT, folder=tmp_path) == "compiling 1\n3\n"
    assert run_python(SCRIPT, folder=tmp_path) == "3\n"


def test_without_a_place_to_keep_it_a_kernel_is_compiled_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])

    @product.kernel
    def following(number: int) -> int:
        return number + 1

    assert following(3) == 4
    with pytest.raises(RuntimeError):
        product.kernel_cache()


def test_a_full_disk_behind_the_cache_costs_only_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(IndexDataCacheFile, "save", full)

    @product.kernel
    def preceding(number: int) -> int:
        return number - 1

    assert preceding(3) == 2
