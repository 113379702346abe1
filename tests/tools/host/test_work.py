"""How far a list of work is, for people."""

import pytest

from tools.host import work
from tools.host.progress import StageProgress


def test_time_left_is_said_for_people(monkeypatch: pytest.MonkeyPatch) -> None:
    assert [work.duration(seconds) for seconds in (0.2, 40, 700, 12000)] == ["1 s", "40 s", "12 min", "3 h 20 min"]
    times, said = iter([0.0, 40.0, 50.0, 60.0]), list[str]()
    monkeypatch.setattr("tools.host.work.time.monotonic", lambda: next(times))
    monkeypatch.setattr(StageProgress, "remark", lambda _, text: said.append(text))
    here: work.Workers[int, int] = work.Here(lambda _: StageProgress())
    ended = work.follow(here, lambda piece, _: -piece, [4, 5, 1], StageProgress(), length=float)
    assert dict(ended) == {4: -4, 5: -5, 1: -1}
    assert said == ["1 of 3 done, about 60 s left", "2 of 3 done, about 6 s left", "3 of 3 done"]
