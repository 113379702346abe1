"""Compiling once per machine, and telling who waits."""

import ctypes
import errno
import os
import shutil
import sys
import threading
import time
from importlib import import_module
from pathlib import Path
from unittest.mock import Mock
from zipfile import ZipFile

import numpy as np
import pytest

from panchroma.offline import kernels_to_compile
from panchroma.offline.numerics import compile as product
from panchroma.offline.numerics.arrays import Ints1
from panchroma.offline.numerics.interpolation import interpolate
from panchroma.shared.arrays import IndexArray
from panchroma.shared.errors import OutputError
from tests.data import ROOT
from tests.python import run_python

KERNEL = """
from .arrays import Ints1
from .compile import Chunks, parallel_kernel
from .functions import mirrored

@parallel_kernel(chunks=lambda places, size: len(places))
def mirror(chunks: Chunks, places: Ints1, size: int):
    for i in range(*chunks):
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


def kept_files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*mirror.zip"))


def test_a_kernel_is_compiled_once_until_a_source_changes_that_kernels_see(tmp_path: Path) -> None:
    copied(tmp_path)
    package = tmp_path / "panchroma"
    assert run_python(SCRIPT, folder=tmp_path) == COMPILED
    for name in ("shared/mosaic.py", "offline/README.md", "offline/._patches.py", "offline/a b.py"):
        path = package / name
        path.write_text((path.read_text() if path.exists() else "") + "\n")
    (package / "offline/.#lock.py").symlink_to("nowhere")
    (package / "offline/patches.py").touch()
    assert run_python(SCRIPT, folder=tmp_path) == KEPT
    # older than all others, as rsync and git may leave it
    before, hour_ago = {}, time.time() - 3600
    for name in ("shared/arrays.py", "offline/burst/motion.py", "offline/numerics/functions.py"):
        path = package / name
        before[path] = text = path.read_text()
        is_called = name.endswith("functions.py")
        other = "@kernel\ndef mirrored(place: int, size: int) -> int:\n    return 7\n"
        path.write_text(text + (other if is_called else "ONE = 1\n"))
        os.utime(path, (hour_ago, hour_ago))
        result = "7 7\n" if is_called else "3 2\n"
        assert run_python(SCRIPT, folder=tmp_path) == "compiling 1 True\n" + result
    for path, text in before.items():
        path.write_text(text)  # several versions are kept
    assert run_python(SCRIPT, folder=tmp_path) == KEPT


def test_what_is_damaged_is_compiled_again_and_told(tmp_path: Path) -> None:
    copied(tmp_path)
    assert run_python(SCRIPT, folder=tmp_path) == COMPILED
    (path,) = kept_files(tmp_path)
    with ZipFile(path) as archive:  # whatever the clock says
        assert {entry.date_time[0] for entry in archive.infolist() if not entry.is_dir()} == {2001}
    data = path.read_bytes()
    middle = len(data) // 2
    for damaged in (data[:-9], data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]):
        path.write_bytes(damaged)
        assert run_python(SCRIPT, folder=tmp_path) == COMPILED
    assert run_python(SCRIPT, folder=tmp_path) == KEPT


# A processor of the same name that lacks something, as a virtual machine may hide it.
LESSER = """
from llvmlite import binding
features = binding.get_host_cpu_features()
features[max(name for name in features if features[name])] = False
binding.get_host_cpu_features = lambda: features
"""


def test_installations_and_processors_share_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    for name in ("one", "two"):
        copied(tmp_path / name)
    assert run_python(SCRIPT, folder=tmp_path / "one") == COMPILED
    for variable, value in (("NUMBA_CPU_NAME", "generic"), ("NUMBA_OPT", "1")):
        with monkeypatch.context() as other:
            other.setenv(variable, value)
            assert run_python(SCRIPT, folder=tmp_path / "one") == COMPILED
    assert run_python(LESSER + SCRIPT, folder=tmp_path / "one") == COMPILED
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    assert run_python(SCRIPT, folder=tmp_path / "two") == KEPT
    assert len(kept_files(tmp_path / "kept")) == 4
    assert not kept_files(tmp_path / "one")


def test_versions_that_were_not_compiled_lately_are_forgotten(tmp_path: Path) -> None:
    copied(tmp_path)
    place = tmp_path / "panchroma/offline/__pycache__/panchroma-kernels"
    others = [place / f"{number:016x}" for number in range(20)]
    strange = [place / "pictures", place / "0123456789abcdeX", place.parent / ("0" * 16)]
    for number, folder in enumerate([*others, *strange]):
        folder.mkdir(parents=True)
        (folder / "file").touch()
        os.utime(folder, (number, number))
    assert run_python(SCRIPT, folder=tmp_path) == COMPILED
    assert [folder for folder in others if folder.exists()] == others[5:]
    assert all(folder.exists() for folder in strange)


def test_a_program_whose_sources_have_changed_keeps_nothing_and_reads_nothing(
    tmp_path: Path,
) -> None:
    """Its kernels are those of the sources that it has imported, or of both."""
    copied(tmp_path)
    assert run_python(SCRIPT, folder=tmp_path) == COMPILED
    edit = """
import pathlib
path = pathlib.Path("panchroma/offline/numerics/functions.py")
path.write_text(path.read_text() + "# changed\\n")
"""
    lines = SCRIPT.splitlines(keepends=True)
    for place in (3, 4):  # before the kernel is imported, and before it is called
        edited = "".join([*lines[:place], edit, *lines[place:]])
        assert run_python(edited, folder=tmp_path) == COMPILED
    assert len(kept_files(tmp_path)) == 1


def without_root() -> None:
    """Let permissions hold for root, too: in a program that this process starts."""
    for capability in (1, 2, 3):  # DAC_OVERRIDE, DAC_READ_SEARCH, FOWNER
        ctypes.CDLL(None).prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP


def run_as_user(folder: Path, script: str = SCRIPT) -> str:
    return run_python(script, folder=folder, preexec_fn=without_root)


ON_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="takes rights from root")


@ON_LINUX
def test_a_folder_that_can_be_read_alone_serves_its_kernels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copied(tmp_path)
    shared = tmp_path / "kept"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(shared))
    monkeypatch.setenv("NUMBA_CACHE_LOCATOR_CLASSES", "UserProvidedCacheLocator")  # no other
    assert run_python(SCRIPT, folder=tmp_path) == COMPILED
    for path in [shared, *shared.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    assert run_as_user(tmp_path) == KEPT
    (path,) = kept_files(shared)
    where = "from panchroma.offline import kernel_cache\nprint(kernel_cache())"
    assert run_as_user(tmp_path, where) == f"{path.parent}\n"
    path.chmod(0)  # somebody else's
    assert run_as_user(tmp_path) == COMPILED
    monkeypatch.setenv("NUMBA_CACHE_LOCATOR_CLASSES", "")
    assert run_as_user(tmp_path) == COMPILED  # and kept beside the sources
    assert run_as_user(tmp_path) == KEPT
    for closed in (path.parent, shared):  # it cannot be listed, then not even looked up
        closed.chmod(0)
        assert str(tmp_path / "panchroma") in run_as_user(tmp_path, where)
    for folder in [shared, *shared.rglob("*/"), path.parent]:
        folder.chmod(0o755)


def more(chunks: product.Chunks, numbers: Ints1, /) -> None:
    for place in range(chunks[0], chunks[1]):
        numbers[place] += 1


@pytest.mark.parametrize(
    ("broken", "error"),
    [
        ("TemporaryDirectory", OSError(errno.ENOSPC, "No space left on device")),
        ("write_durably", OSError(errno.ENOSPC, "No space left on device")),
        ("write_durably", OutputError("no permission")),
    ],
)
def test_without_a_place_for_it_a_kernel_is_compiled_all_the_same(
    broken: str, error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(product, broken, Mock(side_effect=error))
    monkeypatch.setattr(product, "_folders", lambda _: [tmp_path])
    made, numbers = product.ParallelKernel(more, len), np.arange(3)
    made(numbers)
    assert numbers.tolist() == [1, 2, 3]
    assert not made.kept()


def test_all_kernels_are_compiled_ahead_until_they_are_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    import_module("panchroma.offline.burst")  # has kernels of its own
    for kernel in product.kernels.values():
        monkeypatch.setattr(kernel, "compiled", None)
    monkeypatch.setattr(product, "_folders", lambda _: [tmp_path])
    names = kernels_to_compile()
    assert names[0] == "solve_fields"  # takes longest
    assert set(names) == set(product.kernels) >= {"merge", "smooth", "denoise", "solve_linked"}
    for kernel in product.kernels.values():
        kernel._files()[0].touch()
    assert kernels_to_compile() == []


NO_MACHINE_CODE = """
import ctypes, sys
from panchroma.shared.errors import InputError
if len(sys.argv) > 1:
    ctypes.CDLL(None).prctl(65, 1, 0, 0, 0)  # PR_SET_MDWE
for _ in range(2):
    try:
        import panchroma.offline
    except InputError as error:
        print(error)
"""


def test_where_numba_may_not_compile_the_render_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    if sys.platform == "linux" and ctypes.CDLL(None).prctl(66, 0, 0, 0, 0) >= 0:  # PR_GET_MDWE
        first, second = run_python(NO_MACHINE_CODE, "without").splitlines()
        assert first == second
        assert "which this system forbids" in first
    assert run_python(NO_MACHINE_CODE) == ""
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    first, second = run_python(NO_MACHINE_CODE).splitlines()
    assert first == second
    assert "unset NUMBA_DISABLE_JIT" in first
    monkeypatch.delenv("NUMBA_DISABLE_JIT")
    for name, value in (("NUMBA_NUM_THREADS", "0"), ("NUMBA_CPU_FEATURES", "+avx,fma")):
        with monkeypatch.context() as other:
            other.setenv(name, value)
            assert name in run_python(NO_MACHINE_CODE)


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

    def work(chunks: product.Chunks, _: IndexArray) -> None:
        seen.append((chunks[1] - chunks[0], threading.get_ident() == asking))

    monkeypatch.setattr(made, "compiled", work)
    made(np.arange(product.LITTLE))
    assert seen == [(product.LITTLE, True)]
    made(np.arange(4 * product.LITTLE))
    assert sum(size for size, _ in seen[1:]) == 4 * product.LITTLE
    assert len(seen) > 2
