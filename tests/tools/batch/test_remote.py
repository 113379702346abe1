"""Rendering on a real scheduler with two workers, all on this machine: the same bytes, and one that is killed costs only time."""

import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from tests.dask_cluster import cluster
from tests.tools.batch.examples import save_shot
from tests.tools.command import contents, run, start
from tools.batch.journal import NAME

pytest.importorskip("distributed")


def pictures(folder: Path) -> dict[str, bytes]:
    return {name: data for name, data in contents(folder).items() if name.endswith(".tif")}


def test_a_worker_that_is_killed_costs_nothing_but_time(tmp_path: Path, out: Path) -> None:
    count, shots, here = 12, tmp_path / "shots", tmp_path / "here"
    here.mkdir()
    for seed in range(count):
        save_shot(shots / f"{seed % 2}" / f"{seed}.dng", seed, (60, 60))
    (shots / "torn.dng").write_text("no picture")
    before = contents(shots)
    with cluster(tmp_path, 2) as (file, workers):
        rendering = start("render", shots, "-o", out, "--scheduler-file", file, "--json")
        while rendering.poll() is None and not (out / NAME).exists():
            time.sleep(0.005)
        os.kill(workers[0].pid, signal.SIGKILL)
        said, errors = rendering.communicate(timeout=100)
        assert rendering.returncode == 1, errors
        records = [json.loads(line) for line in said.splitlines()]
        assert sum(record["ok"] for record in records) == count, errors
        assert [record["source"] for record in records if not record["ok"]] == [str(shots / "torn.dng")]
        again = run("render", shots, "-o", out, "--scheduler-file", file, "--resume", "--json")
        assert [record.get("current") for record in again.records if record["ok"]] == [True] * count
    run("render", shots, "-o", here, "--workers", "1", code=1)
    assert pictures(out) == pictures(here)
    assert len(pictures(out)) == count
    assert contents(shots) == before
    assert {path.suffix for path in out.rglob("*") if path.is_file()} == {".tif", ".jsonl"}


def test_an_evaluation_is_the_same_by_a_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("scene.npy", np.random.default_rng(0).random((66, 72, 3), np.float32))
    common = ("evaluate", "scene.npy", "--linear", "--sigma", "0.01", "--methods", "paper", "bilinear", "--no-page")
    Path("there").mkdir()
    Path("here").mkdir()
    with cluster(tmp_path, 1) as (file, _):
        outcome = run(*common, "-o", "there", "--scheduler-file", file)
    assert outcome.code == 0, outcome.err
    run(*common, "-o", "here", "--workers", "1", code=0)
    there, here = (json.loads(Path(folder, "evaluation.json").read_text()) for folder in ("there", "here"))
    assert there["figures"] == here["figures"]
    assert there["figures"]


def test_a_scheduler_that_does_not_answer_is_usage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tools.batch.cluster._SECONDS", 1)
    (line,) = run("render", save_shot(tmp_path / "a.dng"), "-o", tmp_path, "--scheduler", "tcp://127.0.0.1:1", code=2).errors
    assert "tcp://127.0.0.1:1: no scheduler answers" in line
