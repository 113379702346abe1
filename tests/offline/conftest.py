"""What several tests of the renderer need."""

from collections.abc import Iterator

import pytest

from offline import available_threads, kernels_to_compile, threads, use_threads
from tools.host.compilation import compile_all
from tools.host.processors import processors


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """All kernels are compiled, side by side, before the first test would compile them one by one."""
    for _, error in compile_all(kernels_to_compile(), processors(), print):
        assert error is None


@pytest.fixture
def each_thread_count() -> Iterator[Iterator[int]]:
    """Iterates over all numbers of threads, each in use until the next."""
    before = threads()

    def counts() -> Iterator[int]:
        for count in range(1, available_threads() + 1):
            use_threads(count)
            yield count

    yield counts()
    use_threads(before)
