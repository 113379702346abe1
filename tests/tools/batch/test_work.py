"""A list of work: how far it is, for people; and work ahead of its use: in order, bounded, and errors reach whoever iterates."""

from collections.abc import Iterator

import pytest

from tools.batch import work
from tools.batch.progress import StageProgress
from tools.io.ahead import WAITING, ahead


def test_time_left_is_said_for_people(monkeypatch: pytest.MonkeyPatch) -> None:
    assert [work.duration(seconds) for seconds in (0.2, 40, 700, 12000)] == ["1 s", "40 s", "12 min", "3 h 20 min"]
    times, said = iter([0.0, 40.0, 50.0, 60.0]), list[str]()
    monkeypatch.setattr("tools.batch.work.time.monotonic", lambda: next(times))
    monkeypatch.setattr(StageProgress, "remark", lambda _, text: said.append(text))
    here: work.Workers[int, int] = work.Here(lambda _: StageProgress())
    ended = work.follow(here, lambda piece, _: -piece, [4, 5, 1], StageProgress(), length=float)
    assert dict(ended) == {4: -4, 5: -5, 1: -1}
    assert said == ["1 of 3 done, about 60 s left", "2 of 3 done, about 6 s left", "3 of 3 done"]


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
