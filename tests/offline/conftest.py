"""What several tests of the renderer need."""

from collections.abc import Iterator

import pytest

from panchroma.offline import threads, use_threads
from panchroma.offline.numerics import compile as compiling


@pytest.fixture(scope="session", autouse=True)
def compiled_first(compiled: None) -> None:
    """See `compiled`."""


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
