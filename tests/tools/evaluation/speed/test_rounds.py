"""Timing in turns."""

import pytest

from offline import PAPER, render
from shared import CfaPattern
from tests.offline.scenes import shot
from tools.evaluation.speed.rounds import StageClock, Timing, alternate


def test_everything_has_its_turn_and_the_order_is_reversed_each_time() -> None:
    turns: list[str] = []
    done: list[int] = []
    works = {name: (lambda name=name: turns.append(name)) for name in "abc"}
    found = alternate(works, 3, lambda: done.append(len(turns)))
    assert "".join(turns) == "abccbaabccba"
    assert done == list(range(1, 13))
    assert {name: len(seconds) for name, seconds in found.items()} == {"a": 3, "b": 3, "c": 3}  # the first round does not count


def test_seconds_are_those_of_the_work_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: now[0])

    def work(seconds: float) -> None:
        now[0] += seconds

    def between() -> None:
        now[0] += 100.0

    found = alternate({"slow": lambda: work(8.0), "fast": lambda: work(2.0)}, 2, between)
    assert found == {"slow": (8.0, 8.0), "fast": (2.0, 2.0)}


def test_ratios_are_taken_round_by_round() -> None:
    """A machine that was four times slower for one round changes no ratio."""
    ours, theirs = Timing((1.0, 4.0, 1.0), 10**6), Timing((3.0, 12.0, 3.0), 10**6)
    assert ours.times_as_fast_as(theirs) == 3
    assert ours.speed == (0.25, 1.0, 1.0)


def test_a_clock_tells_every_stage_of_every_run() -> None:
    clock, mosaic = StageClock(), shot(CfaPattern.bayer(), (24, 30))
    rendering = [clock.run(lambda: render(mosaic, PAPER, clock)) for _ in range(3)]
    assert all(rendering)
    stages = clock.seconds(2)
    assert list(stages) == ["luminance", "chromaticity", "affinity", "propagation", "refinement"]
    assert all(len(seconds) == 2 and min(seconds) > 0 for seconds in stages.values())


def test_parts_of_steps_are_added_up(monkeypatch: pytest.MonkeyPatch) -> None:
    now, clock = [0.0], StageClock()
    monkeypatch.setattr("time.perf_counter", lambda: now[0])

    def work() -> None:
        clock.stage("colour", 2)
        for name in "abab":
            now[0] += 1.0
            clock.part(name)
        now[0] += 1.0

    clock.run(work)
    assert clock.seconds(1) == {"a": (3.0,), "b": (2.0,)}
