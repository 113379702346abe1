"""Work ahead of its use: in order, bounded, and errors reach whoever iterates."""

from collections.abc import Iterator

import pytest

from tools.host.ahead import WAITING, ahead


def test_no_more_pieces_are_taken_than_the_queue_holds() -> None:
    taken, used = 0, 0

    def pieces() -> Iterator[int]:
        nonlocal taken
        for taken in range(1, 100):
            assert taken - used <= 2 + WAITING
            yield taken

    for used, found in enumerate(ahead(lambda piece: piece, pieces(), 2), 1):
        assert found == used
    assert used == 99


def test_errors_of_the_work_and_of_the_pieces_are_raised() -> None:
    def fails(piece: int) -> int:
        raise ValueError(piece)

    def stops() -> Iterator[int]:
        yield 1
        raise KeyboardInterrupt

    with pytest.raises(ValueError, match="1"):
        list(ahead(fails, [1, 2, 3]))
    with pytest.raises(KeyboardInterrupt):
        list(ahead(abs, stops()))
