"""A few trials of each kind, and the trials seen to notice what they are for."""

import random
import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from tests.faults import surroundings, trials
from tests.faults.scenario import Scenario, known, replacing
from tests.faults.worlds import scene


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    scenes = {"scene.npy": scene(0)}
    return known("simulate", ["simulate", *scenes, "-o", "out", "--truth"], scenes, tmp_path_factory.mktemp("known") / "world")


@pytest.mark.parametrize("point", [5, 12])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_an_interruption_at_a_step_with_files_loses_nothing(
    scenario: Scenario, tmp_path: Path, point: int, number: signal.Signals
) -> None:
    class Chance(random.Random):
        """Always a step, and always this one."""

        def random(self) -> float:
            return 0.0

        def randint(self, low: int, high: int) -> int:
            return point

    chosen = replacing(scenario) if point == 12 else scenario
    assert trials.interrupted(chosen, tmp_path / "world", number, Chance(), 1.0) == []


@pytest.mark.parametrize(
    "trial",
    [
        lambda scenario, folder: trials.full_disk(replacing(scenario), folder, 1),
        lambda scenario, folder: trials.file_limit(scenario, folder, 2000),
        trials.read_only,
        trials.two_at_once,
        lambda scenario, folder: trials.own_input(scenario, folder, "hard"),
        trials.case_alone,
    ],
    ids=["full disk", "limit", "read-only", "two at once", "input", "case"],
)
def test_what_is_wrong_outside_leaves_everything_in_order(
    scenario: Scenario, tmp_path: Path, trial: Callable[[Scenario, Path], list[str]]
) -> None:
    assert trial(scenario, tmp_path / "world") == []


@pytest.mark.parametrize(
    "trial",
    [
        *(partial(surroundings.planted, kind=kind) for kind in ("symbolic link", "hard link", "pipe")),
        *(partial(surroundings.odd_names, environment=each) for each in ({}, {"LC_ALL": "C", "PYTHONUTF8": "0"})),
        surroundings.no_place,
        surroundings.empty_home,
        partial(surroundings.ctrl_c, chance=random.Random(0), seconds=0.5),
    ],
)
def test_hostile_surroundings_lose_nothing_and_show_nothing(
    scenario: Scenario, tmp_path: Path, trial: Callable[[Scenario, Path], list[str]]
) -> None:
    assert trial(scenario, tmp_path / "world") == []


def test_the_trials_notice(scenario: Scenario, tmp_path: Path) -> None:
    folder = tmp_path / "world"
    older = replacing(scenario)
    older.lay_out(folder)
    assert older.faults(folder, finished=False) == []
    assert len(older.faults(folder, finished=True)) == len(older.outputs) == 2
    (folder / "out" / "scene.dng").write_bytes(b"half")
    (folder / "out" / "scene.truth.tif").unlink()
    (folder / "out" / ".x.12345678.panchroma.part").touch()
    (folder / "out" / "stranger").touch()
    (folder / "scene.npy").write_bytes(b"changed")
    assert sorted(older.faults(folder, finished=False)) == [
        "scene.dng is neither old nor new (4 bytes)",
        "scene.npy was changed",
        "scene.truth.tif is missing",
        "stranger was left behind",
    ]
    assert ".x.12345678.panchroma.part was left behind" in older.faults(folder, finished=True)
    other = replace(scenario, outputs={**scenario.outputs, "more.dng": ""})
    assert "more.dng is missing" in trials.two_at_once(other, tmp_path / "other")
