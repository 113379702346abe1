"""For all tests: signals do what they do in a terminal, a disk can be full, libraries compute in
one thread, bytecode is kept.

A shell that runs the tests in the background has them ignore SIGINT, nohup SIGHUP, and their
children too.

NumPy's OpenBLAS otherwise has a thread per processor, which take turns in waiting, at full speed,
for each other: with a test on every processor a small fit takes 25 times as long.

With PYTHONDONTWRITEBYTECODE, each of the many processes that tests start would compile all packages
for itself, in 1.5 seconds.
"""

import collections
import errno
import multiprocessing
import os
import signal
import stat
import sys
from collections.abc import Callable
from unittest.mock import Mock

import pytest

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


def pytest_configure(config: pytest.Config) -> None:
    """Let pytest-xdist hand out files in the order of their names: those with few tests, which it
    puts last, take longest.
    """
    config.option.loadscopereorder = False


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say in a line each what was not tested, and how to get what it needs."""
    reasons = collections.Counter(
        str(report.longrepr[2]).removeprefix("Skipped: ")
        for report in terminalreporter.stats.get("skipped", [])
        if isinstance(report.longrepr, tuple)
    )
    if reasons:
        terminalreporter.section("not tested here")
    for reason, count in sorted(reasons.items()):
        terminalreporter.write_line(f"{count:4} {reason}")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the one test that takes a minute."""
    items.sort(key=lambda item: item.path.name != "test_types.py")


@pytest.fixture(scope="session")
def compiled() -> None:
    """All kernels are compiled, side by side, before the first test would compile them one by one.

    Where tests run in several processes, the second begins at the other end: each finds on the disk
    what the other has compiled. A process that has compiled kernels has to render the bytes that
    all others render, which load them. No later test could tell.
    """
    import panchroma.offline.burst  # noqa: F401 - has kernels of its own
    from panchroma.offline import available_threads, compile_kernel, kernels_to_compile
    from tests.golden import render as golden

    if names := kernels_to_compile():
        if os.environ.get("PYTEST_XDIST_WORKER") == "gw1":
            names.reverse()
        count = max(1, available_threads() // int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))
        with multiprocessing.get_context("spawn").Pool(count) as pool:
            pool.map(compile_kernel, names, 1)
            asked = [pool.apply_async(golden.now) for _ in range(count)]
            made = [each.get().digests for each in asked]
        assert all(each == golden.now().digests for each in made), (
            "who compiles kernels renders other bytes than who loads them"
        )


@pytest.fixture(scope="session", autouse=True)
def compiled_first(request: pytest.FixtureRequest) -> None:
    """Where all tests run, some of any room render, in several processes at once."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        request.getfixturevalue("compiled")


@pytest.fixture(params=[True, False], ids=["links", "no links"])
def links(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file system with hard links, and one without."""

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    if not request.param:
        monkeypatch.setattr(os, "link", refuse)


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """A function after whose call os.fsync fails with the error `number`."""

    def fill(number: int = errno.ENOSPC) -> None:
        full = Mock(side_effect=OSError(number, os.strerror(number)))
        monkeypatch.setattr(os, "fsync", full)

    return fill


@pytest.fixture
def unsynced_folders(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """A function after whose call os.fsync of every folder fails with the error `number`; that of
    files succeeds.
    """
    fsync = os.fsync

    def refuse(number: int) -> None:
        def sync(descriptor: int) -> None:
            if stat.S_ISDIR(os.fstat(descriptor).st_mode):
                raise OSError(number, os.strerror(number))
            fsync(descriptor)

        monkeypatch.setattr(os, "fsync", sync)

    return refuse


def pytest_make_parametrize_id(config: pytest.Config, val: object, argname: str) -> str | None:
    """Name long bytes by their argument: a profile holds the second in which it was made, and all
    workers have to collect the same tests.
    """
    return argname if isinstance(val, bytes) and len(val) > 64 else None
