import os
import signal
import threading
import time
from pathlib import Path

import pytest

from shared.errors import InputError
from tools.host.countdown import Countdown, duration
from tools.host.workers import BASE_BYTES, PIXEL_BYTES, need, processes, run


def double(value: int) -> int:
    if value < 0:
        raise InputError("is negative")
    return 2 * value


def die(value: int) -> int:
    os._exit(value)


def linger(folder: str) -> str:
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(60)
    return folder


@pytest.mark.parametrize("count", [1, 2])
def test_every_piece_is_done_and_an_error_stops_no_other(count: int) -> None:
    found = dict(run(double, [1, 2, -3, 4], count))
    assert isinstance(error := found.pop(-3), InputError)
    assert str(error) == "is negative"
    assert found == {1: 2, 2: 4, 4: 8}


def test_a_process_that_dies_is_told() -> None:
    with pytest.raises(InputError, match="want of memory"):
        list(run(die, [9, 9], 2))


def test_leaving_early_stops_the_others(tmp_path: Path) -> None:
    """As an interrupt does: the generator is closed while others are at work."""
    pieces = [str(tmp_path), str(tmp_path) + "/"]
    work = run(linger, pieces, 2)

    done = threading.Event()

    def when_both_work() -> None:
        while len(list(tmp_path.iterdir())) < 2 and not done.is_set():
            time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=when_both_work)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        next(work)
    work.close()
    done.set()
    thread.join()
    workers = [int(path.name) for path in tmp_path.iterdir()]
    assert len(workers) == 2
    for _ in range(100):
        if not any(Path(f"/proc/{worker}/cmdline").exists() and _running(worker) for worker in workers):
            break
        time.sleep(0.05)
    assert not any(_running(worker) for worker in workers)


def _running(worker: int) -> bool:
    try:
        return "State:\tZ" not in Path(f"/proc/{worker}/status").read_text()
    except OSError:
        return False


def test_processes_share_the_memory() -> None:
    one = need(10**6)
    assert one == BASE_BYTES + PIXEL_BYTES * 10**6
    assert [processes(4, memory, 10**6) for memory in (one - 1, one, 3 * one, 100 * one)] == [0, 1, 3, 4]


def test_time_left_is_said_for_people() -> None:
    assert [duration(seconds) for seconds in (0.2, 40, 700, 12000)] == ["1 s", "40 s", "12 min", "3 h 20 min"]
    countdown = Countdown(10, 3)
    assert str(countdown) == "0 of 3 done"
    countdown.finished(4)
    assert str(countdown).startswith("1 of 3 done, about ")
    countdown.finished(4)
    countdown.finished(2)
    assert str(countdown) == "3 of 3 done"
    assert countdown.fraction == 1
