"""Processes that share the work: each piece once, a dead one replaced, none left behind; and several commands in one folder."""

import os
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from offline import PAPER
from shared import read_dng
from shared.errors import InputError, PanchromaError
from tests.tools.batch.examples import save_shot
from tests.tools.command import contents, ended, results, run, start
from tools.batch import signals
from tools.batch.checks import needed_memory
from tools.batch.console import Console, WorkerFault, fault
from tools.batch.journal import NAME
from tools.batch.processes import Processes
from tools.batch.progress import Note, StageProgress
from tools.io.kind import PictureKind


def double(piece: int, listener: StageProgress) -> tuple[int, int]:
    listener.note(f"at {piece}")
    if piece < 0:
        raise InputError("is negative")
    if piece == 0:
        raise MemoryError
    return 2 * piece, os.getpid()


def odd(piece: int, listener: StageProgress) -> int:
    return [0][piece]


def die_once(folder: Path, piece: int, listener: StageProgress) -> int:
    """Piece 3 ends its process the first time, piece 5 every time."""
    if piece == 5 or (piece == 3 and not (folder / "died").exists()):
        (folder / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return piece


def linger(folder: Path, piece: int, listener: StageProgress) -> None:
    try:
        (folder / f"{os.getpid()}.begun").touch()
        time.sleep(60)
    finally:
        (folder / f"{os.getpid()}.left").touch()


def pool(
    work: Callable[[Any, StageProgress], Any], pieces: Iterable[Any], count: int = 2, note: Note = print
) -> Iterator[tuple[Any, Any]]:
    return Processes(count, note, "use fewer `workers`")(work, list(pieces))


@pytest.mark.parametrize("count", [1, 2])
def test_pieces_are_shared_by_processes_that_stay_and_an_error_stops_no_other(count: int) -> None:
    notes: list[str] = []
    found = dict(pool(double, range(-1, 20), count, notes.append))
    assert (str(found.pop(-1)), type(found.pop(0))) == ("is negative", MemoryError)
    assert {piece: result[0] for piece, result in found.items()} == {piece: 2 * piece for piece in range(1, 20)}
    processes = {result[1] for result in found.values()}
    assert processes == {os.getpid()} if count == 1 else os.getpid() not in processes
    assert len(processes) <= count
    assert sorted(notes) == sorted(f"at {piece}" for piece in range(-1, 20))


def test_what_a_dead_process_was_at_is_done_again_once(tmp_path: Path) -> None:
    found = dict(pool(partial(die_once, tmp_path), range(8)))
    killed = found.pop(5)
    assert found == {piece: piece for piece in range(8) if piece != 5}
    assert isinstance(killed, PanchromaError)
    assert str(killed) == "its process was killed, most likely for want of memory; use fewer `workers`"


def test_a_fault_in_a_worker_is_told_with_its_place() -> None:
    for _, error in pool(odd, [1, 2]):
        assert isinstance(error, WorkerFault)
        assert fault(error).startswith("a fault of Panchroma, please report it: IndexError in ")
        assert "work.py" in str(error)
        assert ", in odd\n    return [0][piece]" in error.trace.replace("~", "").replace("^", "")


def test_the_traceback_of_a_fault_in_workers_is_shown_once(capsys: pytest.CaptureFixture[str]) -> None:
    for verbose in (False, True):
        console = Console(verbose=verbose)
        for _, error in pool(odd, [1, 2, 3]):
            console.error(fault(error), cause=error)
        shown = capsys.readouterr().err
        assert (shown.count("Traceback"), shown.count(", in odd")) == (verbose, verbose)
        assert shown.count("please report it") == 3


def test_leaving_early_stops_all_in_order(tmp_path: Path) -> None:
    """As an interrupt does."""
    work = pool(partial(linger, tmp_path), [1, 2])

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


@pytest.mark.parametrize("count", [1, 2])
def test_an_interrupt_that_an_import_has_swallowed_stops_the_work(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signals, "_received", [signals.Terminated(signal.SIGINT)])
    with pytest.raises(signals.Terminated):
        list(pool(double, [1, 2, 3], count))


def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    script = (
        "import sys, pathlib, functools; from tests.tools.batch.test_processes import linger, pool\n"
        "if __name__ == '__main__': list(pool(functools.partial(linger, pathlib.Path(sys.argv[1])), [1, 2]))"
    )
    with start(tmp_path, script=script) as parent:
        _wait_for(lambda: len(list(tmp_path.glob("*.begun"))) == 2)
        parent.kill()
    _wait_for(lambda: len(list(tmp_path.glob("*.left"))) == 2)


def _wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_workers_give_the_same_bytes_as_one_process(tmp_path: Path) -> None:
    """Also of a shot that needs more than the share of one of two processes: it waits for all of the memory."""
    shots = [save_shot(tmp_path / "shots" / f"{seed}.dng", seed) for seed in range(3)]
    shots.append(save_shot(tmp_path / "shots" / "large.dng", 9, (1200, 1200)))
    (tmp_path / "shots" / "bad.dng").write_text("no picture")
    small, large = (needed_memory(read_dng(shot), PictureKind.of("npy"), PAPER) for shot in (shots[0], shots[-1]))
    limit = 2 * small // 2**20 + 8
    assert small < limit * 2**20 / 2 < large < limit * 2**20
    before = contents(tmp_path / "shots")
    for count in "12":
        limited = ("--workers", count, "--max-memory", f"{limit}M", "-f", "npy", "--preset", "paper")
        outcome = run("render", tmp_path / "shots", "-o", tmp_path / count, "--json", *limited, code=1)
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
    records = [record for process in running for record in ended(process, code=0).records]
    made = [record["output"] for record in records if not record.get("current")]
    assert sorted(made) == sorted(str(out / f"{seed}.tif") for seed in range(count))
    assert results(out) == {f"{seed}.tif" for seed in range(count)}
    assert len((out / NAME).read_text().splitlines()) == count
