"""A few trials of each kind."""

import random
import signal
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import pytest

from tests.faults import trials
from tests.faults.__main__ import ONCE, TRIALS, Trial
from tests.faults.scenario import Scenario, known, replacing, scene


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    folder = tmp_path_factory.mktemp("known") / "world"
    return known({"scene.npy": scene(0)}, folder, "simulate", "--truth")


@pytest.mark.parametrize("point", [5, 18])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_an_interruption_at_a_step_with_files_loses_nothing(
    scenario: Scenario, tmp_path: Path, point: int, number: signal.Signals
) -> None:
    # always a step, and always this one
    chance = Mock(random=lambda: 0.0, randint=lambda *_: point)
    chosen = replacing(scenario) if point == 18 else scenario
    assert trials.interrupted(chosen, tmp_path / "world", number, chance, 1.0) == []


@pytest.mark.parametrize(
    ("what", "trial"),
    [*TRIALS, *ONCE, ("Ctrl-C", partial(trials.ctrl_c, chance=random.Random(0), seconds=0.5))],
)
def test_hostile_surroundings_lose_nothing_and_show_nothing(
    scenario: Scenario, tmp_path: Path, what: str, trial: Trial
) -> None:
    assert trial(replacing(scenario) if what == "disk full" else scenario, tmp_path / "world") == []
