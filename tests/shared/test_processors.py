"""How many threads a renderer is to use."""

import threading

import pytest

from panchroma.shared.processors import THREADS, available_threads, threads, use_threads


def test_the_number_of_threads_is_that_of_the_calling_thread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before, elsewhere = threads(), []
    use_threads(5)
    other = threading.Thread(target=lambda: elsewhere.append(threads()))
    other.start()
    other.join()
    assert (threads(), elsewhere) == (5, [available_threads()])
    with pytest.raises(ValueError, match="1 or more"):
        use_threads(0)
    use_threads(before)
    for asked, count in (("3", 3), ("0", None), ("many", None)):
        monkeypatch.setenv(THREADS, asked)
        assert available_threads() == count or count is None
        assert available_threads() >= 1
