from collections.abc import Iterator

import pytest

from offline.kernels.compile import available_threads, threads, use_threads


@pytest.fixture
def thread_counts() -> Iterator[Iterator[int]]:
    """1, 2, ... to what this machine has: the body of a loop over them runs with that number of threads."""

    def counts() -> Iterator[int]:
        for count in range(1, available_threads() + 1):
            use_threads(count)
            yield count

    before = threads()
    yield counts()
    use_threads(before)
