"""What several tests of the renderer need."""

import multiprocessing
import os
from collections.abc import Iterator

import pytest

from offline import available_threads, compile_kernel, kernels_to_compile, threads, use_threads
from offline.kernels import compile as compiling
from tests.golden import render as golden


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """All kernels are compiled, side by side, before the first test would compile them one by one.

    Where tests run in several processes, the second begins at the other end: each finds on the disk what the other has compiled.
    A process that has compiled kernels has to render the bytes that all others render, which load them. No later test could tell.
    """
    if names := kernels_to_compile():
        if os.environ.get("PYTEST_XDIST_WORKER") == "gw1":
            names.reverse()
        with multiprocessing.get_context("spawn").Pool(available_threads()) as pool:
            pool.map(compile_kernel, names, 1)
            made = [each.get().digests for each in [pool.apply_async(golden.now) for _ in range(available_threads())]]
        assert all(each == golden.now().digests for each in made), "who compiles kernels renders other bytes than who loads them"


@pytest.fixture
def each_thread_count(monkeypatch: pytest.MonkeyPatch) -> Iterator[Iterator[int]]:
    """Iterates over all numbers of threads, each in use until the next, for little work too."""
    monkeypatch.setattr(compiling, "LITTLE", 0)
    before = threads()

    def counts() -> Iterator[int]:
        for count in (1, 2, 3):
            use_threads(count)
            yield count

    yield counts()
    use_threads(before)
