"""How many threads a renderer is to use."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from panchroma.shared.errors import InputError
from panchroma.shared.processors import THREADS, available_threads, threads, use_threads


def test_the_number_of_threads_is_that_of_the_calling_thread() -> None:
    before = threads()
    use_threads(5)
    with ThreadPoolExecutor(1) as elsewhere:
        assert elsewhere.submit(threads).result() == available_threads()
    assert threads() == 5
    with pytest.raises(ValueError, match="1 or more"):
        use_threads(0)
    use_threads(before)


def test_the_environment_sets_the_number_or_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(THREADS, "3")
    assert available_threads() == 3
    monkeypatch.setenv(THREADS, "")  # as not set
    assert available_threads() >= 1
    for asked in ("0", "-2", "many", "1.5", " 2"):
        monkeypatch.setenv(THREADS, asked)
        with pytest.raises(InputError, match=r"PANCHROMA_THREADS is .*; change or unset it"):
            available_threads()
