"""How work is cut into chunks and shared among threads."""

import os
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from panchroma.offline.numerics import chunks as product
from panchroma.shared.processors import threads
from tests.python import run_python


@pytest.mark.parametrize(("count", "together"), [(0, 1), (1, 1), (7, 1), (7, 3), (7, 9)])
def test_every_chunk_is_worked_on_once(
    each_thread_count: Iterator[int], count: int, together: int
) -> None:
    for _ in each_thread_count:
        seen: list[range] = []
        product.in_chunks(
            lambda first, end, seen=seen: seen.append(range(first, end)),  # type: ignore[misc]
            count,
            together,
        )
        assert sorted(chunk for share in seen for chunk in share) == list(range(count))
        assert all(len(share) <= together for share in seen)


@pytest.mark.parametrize("rows", [0, 1, 5, 130])
def test_strips_cover_every_row_once(each_thread_count: Iterator[int], rows: int) -> None:
    for _ in each_thread_count:
        seen = np.zeros(rows, int)
        product.in_strips(lambda share, seen=seen: np.add.at(seen, share, 1), rows, 3)  # type: ignore[misc]
        assert (seen == 1).all()


def test_threads_work_side_by_side(each_thread_count: Iterator[int]) -> None:
    for count in each_thread_count:
        together = threading.Barrier(count)
        # an error if one does not come
        product.in_chunks(lambda *_, wait=together.wait: wait(10), count)


def test_chunks_of_chunks_start_no_more_threads(each_thread_count: Iterator[int]) -> None:
    for count in each_thread_count:
        inside: list[int] = []
        product.in_chunks(lambda *_, inside=inside: inside.append(threads()), 9)
        assert inside == [1] * 9
        product.in_chunks(lambda *_, inside=inside: inside.append(threads()), 1)
        assert inside[-1] == threads() == count


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_error_stops_what_has_not_begun_and_is_raised_when_the_rest_is_finished(
    each_thread_count: Iterator[int], error: type[BaseException]
) -> None:
    for count in each_thread_count:
        begun: list[int] = []
        finished: list[int] = []

        def work(
            first: int, _: int, begun: list[int] = begun, finished: list[int] = finished
        ) -> None:
            begun.append(first)
            if first == 2:
                raise error
            time.sleep(0.01)
            finished.append(first)

        with pytest.raises(error):
            product.in_chunks(work, 1000)
        assert len(finished) == len(begun) - 1
        assert len(begun) < 500, f"{count} threads went on"


FORKED = """
import os, warnings
import numpy as np
from panchroma.offline.numerics.interpolation import interpolate
from panchroma.offline import use_threads

warnings.simplefilter("ignore", DeprecationWarning)  # of Python 3.12: fork in a process with threads
use_threads(3)
plane = np.zeros((400, 400), np.float32)
interpolate(np.ones((4, 4), np.float32), (1.0, 1.0), 150, plane)
child = os.fork()
if child == 0:
    again = np.zeros_like(plane)
    interpolate(np.ones((4, 4), np.float32), (1.0, 1.0), 150, again)
    os._exit(0 if (again == plane).all() and plane.all() else 1)
print("exit code", os.waitpid(child, 0)[1])
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_child_of_a_process_that_has_rendered_renders() -> None:
    assert run_python(FORKED) == "exit code 0\n"
