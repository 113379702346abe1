"""Work in parallel: each item once, a dead process costs one, none left behind; and several
commands in one folder.
"""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from panchroma.offline import PAPER
from panchroma.shared import InputError, PanchromaError, read_dng
from panchroma.tools.batch.compilation import compile_all
from panchroma.tools.batch.console import Console, fault
from panchroma.tools.batch.journal import NAME
from panchroma.tools.batch.memory import needed_memory
from panchroma.tools.batch.parallel import duration, follow, in_processes, one_by_one
from panchroma.tools.batch.progress import Note, StageProgress
from panchroma.tools.io.kind import PictureKind
from tests.tools.batch.examples import save_shot, without_semaphores
from tests.tools.command import contents, ended, results, run, start


def double(item: int, listener: StageProgress) -> tuple[int, int]:
    listener.note(f"at {item}")
    if item < 0:
        raise InputError("is negative")
    if item == 0:
        raise MemoryError
    return 2 * item, os.getpid()


def fail(foreseen: bool, listener: StageProgress) -> int:
    try:
        raise IndexError("odd")
    except IndexError:
        if foreseen:
            raise InputError("damaged") from None
        raise


def die(item: int, listener: StageProgress) -> int:
    if item == 5:
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def linger(folder: Path, item: int, listener: StageProgress) -> None:
    (folder / f"{os.getpid()}.begun").touch()
    time.sleep(60)


def pool(
    function: Callable[[Any, StageProgress], Any], items: Iterable[Any], note: Note = print
) -> Iterator[tuple[Any, Any]]:
    with in_processes(function, list(items), 2, note, "use fewer `jobs`") as results:
        yield from results


def test_items_are_shared_by_processes_that_stay_and_an_error_stops_no_other() -> None:
    notes: list[str] = []
    results = dict(pool(double, range(-1, 20), notes.append))
    assert (str(results.pop(-1)), type(results.pop(0))) == ("is negative", MemoryError)
    assert all(result[0] == 2 * item for item, result in results.items())
    assert set(results) == set(range(1, 20))
    used = {result[1] for result in results.values()}
    assert os.getpid() not in used
    assert len(used) <= 2
    assert sorted(notes) == sorted(f"at {item}" for item in range(-1, 20))


def test_without_semaphores_one_process_does_all_and_says_so(
    tmp_path: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed in range(3):
        save_shot(tmp_path / "in" / f"{seed}.dng", seed)
    without_semaphores(monkeypatch)
    note = "one process does all the work: no semaphore can be made in /dev/shm (No such device"
    for jobs in (2, 1):  # with one, nothing is slower than it was asked for
        line = f"render --preset paper -j {jobs} --overwrite"
        assert run(line, tmp_path / "in", "-o", out, code=0).err.count(note) == jobs - 1
        assert len(results(out)) == 3
    scenes = "builtin:60x60 builtin:70x60 --methods bilinear --sigma 0"
    assert note in run(f"evaluate {scenes} -j 2 -o", tmp_path / "e", code=0).err
    (ended,) = compile_all(["no such kernel"], 2, lambda _: None)
    assert isinstance(ended[1], Exception)  # as in another process, the error is the result


def test_processes_ask_for_a_folder_that_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(InputError, match=r"current folder is gone, .*; change to another one"):
        list(pool(double, [1, 2]))


def test_a_process_that_is_killed_costs_one_item() -> None:
    results = dict(pool(die, range(8)))
    killed = results.pop(5)
    assert results == {item: item for item in range(8) if item != 5}
    assert isinstance(killed, PanchromaError)
    assert str(killed).endswith("for want of memory; use fewer `jobs`")


def test_processes_that_die_before_they_have_an_item_are_started_again() -> None:
    with in_processes(double, range(1, 5), 2, print, "") as results:
        for child in multiprocessing.active_children():
            child.kill()
        ended: dict[int, Any] = dict(results)
    assert {item: result[0] for item, result in ended.items()} == {1: 2, 2: 4, 3: 6, 4: 8}


@pytest.mark.parametrize("verbose", [False, True])
def test_what_failed_in_a_process_is_told_with_its_traceback_where_it_is_asked_for(
    verbose: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    console, errors = Console(verbose=verbose), dict(pool(fail, [False, True]))
    for foreseen, message in ((False, fault(errors[False])), (True, str(errors[True]))):
        console.error(message, cause=errors[foreseen])
        first, *trace = capsys.readouterr().err.splitlines()
        place = "a fault of Panchroma, please report it: IndexError in parallel.py:"
        assert first.startswith(f"panchroma: {'damaged' if foreseen else place}")
        assert any(line.endswith(", in fail") for line in trace) == verbose
        assert trace[-1:] == ["IndexError: odd"] * verbose


def test_leaving_early_ends_all_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As an interrupt does."""

    def when_both_work(number: int, frame: object) -> None:
        if len(list(tmp_path.glob("*.begun"))) == 2:
            signal.setitimer(signal.ITIMER_REAL, 0)
            raise KeyboardInterrupt

    monkeypatch.setattr("panchroma.tools.batch.parallel._POLL_POOL", 60)
    before = signal.signal(signal.SIGALRM, when_both_work)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05, 0.05)
        with pytest.raises(KeyboardInterrupt):
            list(pool(partial(linger, tmp_path), [1, 2]))
    finally:
        signal.signal(signal.SIGALRM, before)
    for path in tmp_path.glob("*.begun"):
        assert not Path(f"/proc/{path.stem}").exists()


def test_an_interrupt_leaves_no_file_of_processes_that_it_kills(tmp_path: Path, out: Path) -> None:
    for seed in range(2):
        save_shot(tmp_path / "in" / f"{seed}.dng", seed, (900, 900))
    rendering = start("render -j 2 --preset paper", tmp_path / "in", "-o", out)
    while not list(out.glob("*.part")):
        assert rendering.poll() is None
        time.sleep(0.01)
    ended(rendering, signal.SIGINT, code=130)
    assert not list(out.glob("*.part"))


def test_time_left_is_said_for_people(monkeypatch: pytest.MonkeyPatch) -> None:
    words = {0.2: "1 s", 40: "40 s", 700: "12 min", 12000: "3 h 20 min"}
    assert {seconds: duration(seconds) for seconds in words} == words
    times, said = iter([0.0, 40.0, 50.0]), list[str]()
    clock = Mock(monotonic=lambda: next(times))
    monkeypatch.setattr("panchroma.tools.batch.parallel.time", clock)
    monkeypatch.setattr(StageProgress, "remark", lambda _, text: said.append(text))
    results = one_by_one(lambda item, _: -item, [4, 5, 1], lambda _: StageProgress())
    assert dict(follow(results, [4, 5, 1], StageProgress())) == {4: -4, 5: -5, 1: -1}
    assert said == ["1 of 3 done, about 80 s left", "2 of 3 done, about 25 s left", "3 of 3 done"]


def test_processes_give_the_same_bytes_as_one_and_are_as_many_as_fit(tmp_path: Path) -> None:
    shots = [save_shot(tmp_path / "shots" / f"{seed}.dng", seed) for seed in range(3)]
    shots.append(save_shot(tmp_path / "shots" / "large.dng", 9, (600, 600)))
    (tmp_path / "shots" / "bad.dng").write_text("no picture")
    mosaics = read_dng(shots[0]), read_dng(shots[-1])
    small, large = (needed_memory(shot, PictureKind.of("npy"), PAPER) for shot in mosaics)
    before = contents(tmp_path / "shots")
    for jobs, limit in (("1", 3 * large), ("2", 3 * large), ("3", large + small)):
        options = f"--json --jobs {jobs} --max-memory {limit} -f npy --preset paper -o"
        outcome = run("render", tmp_path / "shots", options, tmp_path / jobs, code=1)
        assert sum(record["ok"] for record in outcome.records) == len(shots), outcome.err
        assert len(outcome.errors) == 1
        assert ("memory is enough for 1 at a time" in outcome.err) == (limit < 2 * large)
    one, two, limited = (
        {name: data for name, data in contents(tmp_path / jobs).items() if name != NAME}
        for jobs in "123"
    )
    assert one == two == limited
    assert len(one) == len(shots)
    assert contents(tmp_path / "shots") == before


def test_several_commands_share_a_folder_and_each_file_is_made_once(
    tmp_path: Path, out: Path
) -> None:
    count, options = 12, "--resume --json --jobs 1 --preset paper -o"
    for seed in range(count):
        save_shot(tmp_path / "shots" / f"{seed}.dng", seed)
    running = [start("render", tmp_path / "shots", options, out) for _ in range(3)]
    records = [record for process in running for record in ended(process, code=0).records]
    made = [record["output"] for record in records if not record.get("current")]
    assert sorted(made) == sorted(str(out / f"{seed}.tif") for seed in range(count))
    assert results(out) == {f"{seed}.tif" for seed in range(count)}
    lines = (out / NAME).read_text().splitlines()
    assert [line.endswith('"stamp": ""}') for line in lines].count(True) == count  # of their making
    assert len(lines) == 2 * count
