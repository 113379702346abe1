"""Work on a dask scheduler and its workers, all on this machine: what a killed one costs, and what
the user is told.
"""

import json
import os
import re
import shutil
import signal
import time
from pathlib import Path
from typing import IO

import numpy as np
import pytest

from panchroma.tools.batch import cluster as module
from panchroma.tools.batch.journal import NAME
from tests.dask_cluster import SOURCE, cluster, scheduler, worker
from tests.python import run_python
from tests.tools.batch.examples import save_shot
from tests.tools.command import assert_refused, contents, ended, run, start

pytest.importorskip(
    "distributed", reason="dask: distributed is not installed: pip install -e '.[all,cluster]'"
)


def line_with(stream: IO[str] | None, words: str) -> str:
    """The first line with these words."""
    return next(line for line in stream if words in line)


def pictures(folder: Path) -> dict[str, bytes]:
    return {name: data for name, data in contents(folder).items() if name.endswith(".tif")}


def test_a_worker_that_is_killed_costs_nothing_but_time(tmp_path: Path, out: Path) -> None:
    count, shots, here = 8, tmp_path / "shots", tmp_path / "here"
    for seed in range(count):
        save_shot(shots / f"{seed % 2}" / f"{seed}.dng", seed, (60, 60))
    (shots / "torn.dng").write_text("no picture")
    before = contents(shots)
    with cluster(tmp_path, 2) as (address, workers):
        options = f"--scheduler {address} --json"
        rendering = start("render", shots, "-o", out, options)
        while rendering.poll() is None and not (out / NAME).exists():
            time.sleep(0.005)
        os.kill(workers[0].pid, signal.SIGKILL)
        outcome = ended(rendering, code=1)
        assert sum(record["ok"] for record in outcome.records) == count, outcome.err
        assert_refused(outcome, "not a DNG", name=str(shots / "torn.dng"))
        again = run("render", shots, "-o", out, options, "--resume")
        assert sum(record.get("current", False) for record in again.records) == count
    run("render", shots, "-o", here, "--jobs 1", code=1)
    assert pictures(out) == pictures(here)
    assert len(pictures(out)) == count
    assert contents(shots) == before
    assert {path.suffix for path in out.rglob("*") if path.is_file()} == {".tif", ".jsonl"}


def test_an_evaluation_is_the_same_by_a_worker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("scene.npy", np.random.default_rng(0).random((66, 72, 3), np.float32))
    common = "evaluate scene.npy --linear --sigma 0.01 --methods paper,bilinear"
    with cluster(tmp_path, 1) as (address, _):
        run(f"{common} -o there --scheduler {address}", code=0)
    run(f"{common} -o here --jobs 1", code=0)
    there, here = (
        json.loads(Path(folder, "evaluation.json").read_text()) for folder in ("there", "here")
    )
    assert there["figures"] == here["figures"]
    assert there["figures"]


def test_a_scheduler_that_dies_is_one_line_and_the_next_run_goes_on(
    tmp_path: Path, out: Path
) -> None:
    shots = [save_shot(tmp_path / f"{seed}.dng", seed, (60, 60)) for seed in range(20)]
    with scheduler(tmp_path) as (address, running), worker(tmp_path, address, "one"):
        rendering = start("render", *shots, "-o", out, f"--scheduler {address}")
        line_with(rendering.stdout, ".tif: ")
        running.kill()
        outcome = ended(rendering, code=1)
    (line,) = outcome.errors
    assert re.search("the scheduler tcp.* is gone; what is finished stays", line)
    assert not re.search("Traceback|ERROR", outcome.err)
    again = run("render", *shots, "-o", out, "--resume --json", code=0)
    assert any(record.get("current") for record in again.records)
    assert {path.suffix for path in out.iterdir()} == {".tif", ".jsonl"}


def test_without_workers_it_says_so_and_can_be_interrupted(tmp_path: Path, out: Path) -> None:
    shot = save_shot(tmp_path / "a.dng")
    with scheduler(tmp_path) as (address, _):
        rendering = start("render", shot, "-o", out, "--scheduler", address)
        line = line_with(rendering.stderr, "waiting for workers")
        assert "dask worker --nthreads 1 --host ADDRESS tcp://127.0.0.1:" in line
        assert "Traceback" not in ended(rendering, signal.SIGINT, code=130).err


def test_a_worker_with_another_source_ends_the_run(tmp_path: Path, out: Path) -> None:
    shot, other = save_shot(tmp_path / "0.dng"), tmp_path / "changed"
    shutil.copytree(SOURCE, other, ignore=shutil.ignore_patterns("__pycache__", "notebook"))
    with (other / "panchroma/offline/settings.py").open("a") as file:
        file.write("\nSOMETHING = 1\n")
    with scheduler(tmp_path) as (address, _), worker(tmp_path, address, "changed", other):
        outcome = run("render", shot, "-o", out, "--scheduler", address, code=2)
    (line,) = outcome.errors
    assert "a worker runs another source of Panchroma" in line
    assert not list(out.iterdir())


PRINT_DIGEST = "from panchroma.tools.batch.cluster import source_digest\nprint(source_digest())"


def test_the_source_is_all_that_can_be_imported_and_the_networks(tmp_path: Path) -> None:
    # links become folders, and a wheel lacks the notebook
    left_out = shutil.ignore_patterns("__pycache__", "notebook")
    shutil.copytree(SOURCE, tmp_path, ignore=left_out, dirs_exist_ok=True)
    package, before = tmp_path / "panchroma", run_python(PRINT_DIGEST, folder=SOURCE)

    def changed(*names: str) -> bool:
        for name in names:
            with (package / name).open("ab") as file:
                file.write(b"\n")
        return run_python(PRINT_DIGEST, folder=tmp_path) != before

    assert not changed()
    (package / "tests").mkdir()
    nothing = (
        "tests/a.py",
        "tools/README.md",
        ".DS_Store",
        "shared/.DS_Store",
        "offline/models/._a.onnx",
    )
    copies = "tools/batch/._run.py", "tools/batch/run copy.py", "offline/models/loss-k6.png"
    assert not changed(*nothing, *copies)
    network = next((package / "offline/models").glob("[!.]*.onnx"))
    weights = network.read_bytes()
    assert changed(str(network.relative_to(package)))
    network.write_bytes(weights)
    assert not changed()
    assert changed("tools/batch/new.py")


def test_an_interrupt_leaves_no_file_of_a_worker_that_was_killed(tmp_path: Path, out: Path) -> None:
    shot = save_shot(tmp_path / "a.dng", 1, (900, 900))
    with cluster(tmp_path, 1) as (address, (killed,)):
        rendering = start("render", shot, "-o", out, "--scheduler", address)
        while not any(path.name.startswith(".a.tif.") for path in out.iterdir()):
            assert rendering.poll() is None
            time.sleep(0.01)
        killed.kill()
        killed.wait()
        ended(rendering, signal.SIGINT, code=130)
    assert not list(out.iterdir())


def test_a_scheduler_that_does_not_answer_is_usage(
    tmp_path: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_SECONDS", 1)
    options = ("-o", out, "--scheduler", "tcp://127.0.0.1:1")
    (line,) = run("render", save_shot(tmp_path / "a.dng"), *options, code=2).errors
    assert "tcp://127.0.0.1:1: no scheduler answers" in line
