"""Processes that share the work: each piece once, a dead one replaced, none left behind; and several commands in one folder."""

import json
import os
import signal
import time
from functools import partial
from pathlib import Path

import pytest

from tests.tools.command import contents, results, run, start
from tests.tools.rendering.examples import save_shot
from tools.host import crew
from tools.host.crew import Note
from tools.rendering.journal import NAME


def double(piece: int, note: Note) -> tuple[int, int]:
    note(f"at {piece}")
    return 2 * piece, os.getpid()


def die_once(folder: Path, piece: int, note: Note) -> int:
    """Piece 3 ends its process the first time, piece 5 every time."""
    if piece == 5 or (piece == 3 and not (folder / "died").exists()):
        (folder / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return piece


def linger(folder: Path, piece: int, note: Note) -> None:
    try:
        (folder / f"{os.getpid()}.begun").touch()
        time.sleep(60)
    finally:
        (folder / f"{os.getpid()}.left").touch()


def test_pieces_are_shared_by_processes_that_stay() -> None:
    notes: list[str] = []
    found = dict(crew.run(double, range(20), 2, 1, notes.append))
    assert {piece: result[0] for piece, result in found.items() if result} == {piece: 2 * piece for piece in range(20)}
    assert 1 <= len({result[1] for result in found.values() if result}) <= 2
    assert sorted(notes) == sorted(f"at {piece}" for piece in range(20))


def test_what_a_dead_process_was_at_is_done_again_once(tmp_path: Path) -> None:
    found = dict(crew.run(partial(die_once, tmp_path), range(8), 2, 1, print))
    assert found == {piece: None if piece == 5 else piece for piece in range(8)}


def test_leaving_early_stops_all_in_order(tmp_path: Path) -> None:
    work = crew.run(partial(linger, tmp_path), [1, 2], 2, 1, lambda _: None)

    class Enough(Exception):  # noqa: N818
        pass

    def when_both_work(number: int, frame: object) -> None:
        if len(list(tmp_path.glob("*.begun"))) == 2:
            raise Enough
        signal.setitimer(signal.ITIMER_REAL, 0.05)

    before = signal.signal(signal.SIGALRM, when_both_work)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(Enough):
            next(work)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert len(list(tmp_path.glob("*.left"))) == 2


def test_workers_give_the_same_bytes_as_one_process(tmp_path: Path) -> None:
    """Also of a shot that needs more than the share of one of two processes: it waits for all of the memory."""
    shots = [save_shot(tmp_path / "shots" / f"{seed}.dng", seed) for seed in range(3)]
    shots.append(save_shot(tmp_path / "shots" / "large.dng", 9, (1200, 1200)))
    (tmp_path / "shots" / "bad.dng").write_text("no picture")
    before = contents(tmp_path / "shots")
    for count in "12":
        (tmp_path / count).mkdir()
        limited = ("--workers", count, "--max-memory", "530M", "-f", "npy", "--preset", "paper")
        outcome = run("render", tmp_path / "shots", "-o", tmp_path / count, "--json", *limited)
        assert outcome.code == 1
        assert sum(record["ok"] for record in outcome.records) == len(shots), outcome.err
        assert len(outcome.errors) == 1
    assert Path(outcome.records[-1]["output"]).name == "large.npy"  # alone, after all others
    one, two = ({name: data for name, data in contents(tmp_path / count).items() if name != NAME} for count in "12")
    assert one == two
    assert len(one) == len(shots)
    assert contents(tmp_path / "shots") == before


def test_several_commands_share_a_folder_and_each_file_is_made_once(tmp_path: Path, out: Path) -> None:
    count = 12
    for seed in range(count):
        save_shot(tmp_path / "shots" / f"{seed}.dng", seed)
    running = [start("render", tmp_path / "shots", "-o", out, "--resume", "--json", "--workers", "1") for _ in range(3)]
    said = [process.communicate(timeout=100) for process in running]
    assert [process.returncode for process in running] == [0, 0, 0], said
    made = [
        record["output"] for output, _ in said for line in output.splitlines() if not (record := json.loads(line)).get("current")
    ]
    assert sorted(made) == sorted(str(out / f"{seed}.tif") for seed in range(count))
    assert results(out) == {f"{seed}.tif" for seed in range(count)}
    assert len((out / NAME).read_text().splitlines()) == count


def test_a_killed_worker_costs_nothing_but_time(tmp_path: Path, out: Path) -> None:
    for seed in range(8):
        save_shot(tmp_path / "shots" / f"{seed}.dng", seed, (150, 150))
    process = start("render", tmp_path / "shots", "-o", out, "--workers", "2", "--json")
    killed = 0
    while process.poll() is None and not killed:
        if (out / NAME).exists():  # they are at work
            children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
            workers = [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]
            os.kill(workers[-1], signal.SIGKILL)
            killed += 1
        time.sleep(0.002)
    said, errors = process.communicate(timeout=100)
    assert (process.returncode, killed) == (0, 1), errors
    assert [json.loads(line)["ok"] for line in said.splitlines()] == [True] * 8
    assert {f"{seed}.tif" for seed in range(8)} <= results(out)
