"""Rendering on a real scheduler with two workers, all on this machine: the same bytes, and one that is killed costs only time."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest

from tests.data import ROOT
from tests.tools.command import run
from tests.tools.rendering.examples import contents, save_shot, start
from tools.rendering.journal import NAME

pytest.importorskip("distributed")
LOCAL = ("--host", "127.0.0.1")


@contextmanager
def process(*arguments: str | Path) -> "Iterator[subprocess.Popen[bytes]]":
    """A part of dask, with this source, till the end of the block."""
    line = [sys.executable, "-m", "distributed.cli." + str(arguments[0]), *map(str, arguments[1:]), *LOCAL]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__ADMIN__LOW_LEVEL_LOG_LENGTH": "0"}
    running = subprocess.Popen(line, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield running
    finally:
        running.kill()
        running.wait()


@contextmanager
def cluster(folder: Path, count: int) -> "Iterator[tuple[Path, list[subprocess.Popen[bytes]]]]":
    """A scheduler's file, and its workers: one process and one thread each, without a nurse that would start them again."""
    file = folder / "scheduler.json"
    with ExitStack() as stack:
        stack.enter_context(process("dask_scheduler", "--port", "0", "--no-dashboard", "--no-show", "--scheduler-file", file))
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", folder / "dask")
        deadline = time.monotonic() + 60
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        yield (
            file,
            [
                stack.enter_context(process("dask_worker", "--scheduler-file", file, "--name", str(number), *options))
                for number in range(count)
            ],
        )


def pictures(folder: Path) -> dict[str, bytes]:
    return {name: data for name, data in contents(folder).items() if name.endswith(".tif")}


def test_a_worker_that_is_killed_costs_nothing_but_time(tmp_path: Path) -> None:
    count, shots, out, here = 12, tmp_path / "shots", tmp_path / "out", tmp_path / "here"
    out.mkdir()
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
    assert run("render", shots, "-o", here, "--workers", "1").code == 1
    assert pictures(out) == pictures(here)
    assert len(pictures(out)) == count
    assert contents(shots) == before
    assert {path.suffix for path in out.rglob("*") if path.is_file()} <= {".tif", ".jsonl", ".part", ".lock"}


def test_an_evaluation_is_the_same_by_a_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("scene.npy", np.random.default_rng(0).random((66, 72, 3), np.float32))
    common = ("evaluate", "scene.npy", "--linear", "--sigma", "0.01", "--methods", "paper", "bilinear", "--no-report")
    Path("there").mkdir()
    Path("here").mkdir()
    with cluster(tmp_path, 1) as (file, _):
        outcome = run(*common, "-o", "there", "--scheduler-file", file)
    assert outcome.code == 0, outcome.err
    assert run(*common, "-o", "here", "-j", "1").code == 0
    there, here = (json.loads(Path(folder, "evaluation.json").read_text()) for folder in ("there", "here"))
    assert there["figures"] == here["figures"]
    assert there["figures"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--scheduler", "tcp://127.0.0.1:1"), "tcp://127.0.0.1:1: no scheduler answers"),
        (("--scheduler", "nonsense://x"), "nonsense://x: no scheduler answers"),
        (("--scheduler-file", "missing.json"), "missing.json: there is no such file"),
        (("--scheduler", "tcp://127.0.0.1:1", "--workers", "2"), "--workers cannot be used with a scheduler"),
        (("--scheduler", "tcp://127.0.0.1:1", "--scheduler-file", "x"), "one of them"),
    ],
)
def test_a_scheduler_that_is_none_is_usage(
    tmp_path: Path, options: tuple[str, ...], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tools.host.cluster._SECONDS", 1)
    shot = save_shot(tmp_path / "a.dng")
    outcome = run("render", shot, "-o", tmp_path, *options)
    assert outcome.code == 2, outcome.err
    (line,) = outcome.errors
    assert words in line
