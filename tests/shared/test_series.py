import pytest

from panchroma.shared.series import frame_name, frame_number


@pytest.mark.parametrize("count", [1, 9, 10, 123])
def test_the_frames_of_a_burst_sort_by_name_and_are_known_by_it(count: int) -> None:
    names = [frame_name("a-1", number, count) for number in range(1, count + 1)]
    assert names == sorted(names)
    assert [frame_number(name) for name in names] == [
        ("a-1", number) for number in range(1, count + 1)
    ]


@pytest.mark.parametrize("name", ["rose", "rose-", "-1", "rose-1a", "rose_1", ""])
def test_what_is_no_frame(name: str) -> None:
    assert frame_number(name) is None
