"""What several tests of the renderer need."""

from collections.abc import Iterator

import pytest

from offline import available_threads, threads, use_threads


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
