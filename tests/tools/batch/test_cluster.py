"""What can go wrong with a scheduler and its workers, and what the user is told: by one line, and without an endless wait."""

import pickle
import re
import shutil
import signal
import socket
import time
from pathlib import Path
from typing import IO

import pytest

from shared.errors import InputError
from tests.dask_cluster import cluster, scheduler, worker
from tests.data import ROOT
from tests.tools.batch.examples import save_shot
from tests.tools.command import assert_refused, ended, run, start
from tools.batch import cluster as module
from tools.batch.cluster import Cluster, Program, program, source_digest
from tools.batch.console import WorkerFault
from tools.batch.progress import StageProgress

pytest.importorskip("distributed")


def line_with(stream: IO[str] | None, words: str) -> str:
    """The first line with these words; all lines if there is none."""
    seen = ""
    while line := stream.readline():
        if words in line:
            return line
        seen += line
    return seen


def other_source(folder: Path, name: str) -> Path:
    """A copy of the packages in which one module is another one."""
    for package in ("shared", "device", "offline", "tools"):
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__", "images"))
    (folder / name).write_text((folder / name).read_text("utf-8") + "\nSOMETHING = 1\n", "utf-8")
    return folder


def test_a_scheduler_that_dies_is_one_line_and_the_next_run_goes_on(tmp_path: Path, out: Path) -> None:
    shots = [save_shot(tmp_path / f"{seed}.dng", seed, (120, 120)) for seed in range(40)]
    with scheduler(tmp_path) as (file, running), worker(file, "one"):
        rendering = start("render", *shots, "-o", out, "--scheduler-file", file)
        assert "0.tif" in line_with(rendering.stdout, ".tif: ")
        running.kill()
        outcome = ended(rendering, code=1)
    (line,) = outcome.errors
    assert re.search("is gone, and .* of 40 pieces of work are not finished", line)
    assert not re.search("Traceback|ERROR", outcome.err)
    again = run("render", *shots, "-o", out, "--resume", "--json", code=0)
    assert any(record.get("current") for record in again.records)
    assert {path.suffix for path in out.iterdir()} == {".tif", ".jsonl"}


def test_without_workers_it_says_so_and_can_be_interrupted(tmp_path: Path, out: Path) -> None:
    shot = save_shot(tmp_path / "a.dng")
    with scheduler(tmp_path) as (file, _):
        rendering = start("render", shot, "-o", out, "--scheduler-file", file)
        said = line_with(rendering.stderr, "waiting for workers")
        assert "waiting for workers of tcp://127.0.0.1:" in said
        assert "dask worker --nthreads 1 --host ADDRESS tcp://127.0.0.1:" in said
        assert "Traceback" not in ended(rendering, signal.SIGINT, code=130).err


def test_a_worker_with_another_source_ends_the_run(tmp_path: Path, out: Path) -> None:
    shot = save_shot(tmp_path / "0.dng")
    other = other_source(tmp_path / "changed", "offline/settings.py")
    with scheduler(tmp_path) as (file, _), worker(file, "changed", other):
        outcome = run("render", shot, "-o", out, "--scheduler-file", file, code=2)
    (line,) = outcome.errors
    assert line.startswith("panchroma: worker tcp://127.0.0.1:")
    assert "runs another source of Panchroma" in line
    assert not list(out.iterdir())


def length(piece: str, listener: StageProgress) -> int:
    listener.note(f"at {piece}")
    return len(piece)


def test_a_worker_that_comes_late_refuses_the_work_of_another_source() -> None:
    with pytest.raises(InputError, match="runs another source of Panchroma"):
        module._done("another", length, "four")
    assert module._done(program().source, length, "four") == (4, ["at four"])


def test_a_fault_on_a_worker_comes_with_its_traceback() -> None:
    error, _ = module._done(program().source, lambda piece, listener: length(None, listener), "four")
    told = pickle.loads(pickle.dumps(error))
    assert isinstance(told, WorkerFault)
    assert str(told).startswith("a fault of Panchroma, please report it: ")
    assert told.trace.startswith("Traceback (most recent call last):")
    assert ", in length" in told.trace


class _Client:
    """Stands for dask's: workers by their address, with what each answers."""

    status = "running"
    scheduler = type("Scheduler", (), {"address": "tcp://here:1"})

    def __init__(self, answers: dict[str, object]) -> None:
        self.answers = answers

    def nthreads(self) -> dict[str, int]:
        return dict.fromkeys(self.answers, 1)

    def run(self, function: object, *, on_error: str) -> dict[str, object]:
        return self.answers


def test_the_digest_of_the_source_is_that_of_every_file_that_runs(tmp_path: Path) -> None:
    def changed(name: str) -> bool:
        before = source_digest(tmp_path)
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name + before)
        return source_digest(tmp_path) != before

    for name in ("shared/a.py", "shared/a.py", "offline/models/a.onnx", "tools/batch/b.py", "device/a.py"):
        assert changed(name)
    assert not any(changed(name) for name in ("tools/README.md", "offline/__pycache__/a.pyc", "tests/a.py"))
    (tmp_path / "shared/a.py").rename(tmp_path / "shared/c.py")
    assert changed("shared/a.py")


def test_workers_are_judged_by_what_they_run() -> None:
    ours = program()
    versions = tuple((name, "0.1" if name == "numba" else version) for name, version in ours.versions)
    said: list[str] = []
    older = Program(ours.source, versions)
    Cluster(_Client({"same": ours, "older": older, "old": older, "left": OSError()}), said.append)._check_workers()
    here = dict(ours.versions)["numba"]
    assert said == [
        f"worker older and 1 more: has numba 0.1 (here {here}): its results may differ from those made here in the last bits"
    ]
    for other, words in (
        (Program("x", ours.versions), r"worker other: runs another source of Panchroma \(x, here"),
        (ModuleNotFoundError("No module named 'tools'"), "worker other: has no Panchroma, or another one"),
    ):
        with pytest.raises(InputError, match=words):
            Cluster(_Client({"same": ours, "other": other}), said.append)._check_workers()


def test_an_interrupt_leaves_no_file_of_a_worker_that_was_killed(tmp_path: Path, out: Path) -> None:
    shot = save_shot(tmp_path / "a.dng", 1, (900, 900))
    with cluster(tmp_path, 1) as (file, (killed,)):
        rendering = start("render", shot, "-o", out, "--scheduler-file", file)
        while not any(path.name.startswith(".a.tif.") for path in out.iterdir()):
            assert rendering.poll() is None
            time.sleep(0.01)
        killed.kill()
        killed.wait()
        ended(rendering, signal.SIGINT, code=130)
    assert not list(out.iterdir())


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "the file is empty"),
        ("garbage{", "holds no address"),
        ("[1, 2]", "holds no address"),
        ('{"address": null}', "holds no address"),
        ('{"address": ""}', "holds no address"),
        ("[" * 100_000, "holds no address"),
        (" " * (1 << 21), "bytes"),
        ('{"address": "tls://127.0.0.1:1"}', "no scheduler answers"),
        ('{"address": "tcp://127.0.0.1:1\\n\\u001b[31m"}', "no scheduler answers"),
    ],
)
def test_a_file_that_no_scheduler_wrote_is_one_line(
    tmp_path: Path, out: Path, content: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_SECONDS", 1)
    file = tmp_path / "scheduler.json"
    file.write_text(content, "utf-8")
    assert_refused(run("render", save_shot(tmp_path / "a.dng"), "-o", out, "--scheduler-file", file), words, name=str(file), code=2)


def test_what_takes_connections_and_is_silent_is_one_line(tmp_path: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_SECONDS", 1)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        outcome = run("render", save_shot(tmp_path / "a.dng"), "-o", out, "--scheduler", address)
    assert_refused(outcome, "no scheduler answers (silent for 1 s)", name=address, code=2)
