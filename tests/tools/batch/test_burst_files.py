"""Which shots are one burst."""

from pathlib import Path

import pytest

from panchroma.shared.errors import InputError
from panchroma.tools.batch.burst_files import series, series_stem
from panchroma.tools.batch.folders import DNGS, Source, search


def sources_in(folder: Path, *names: str) -> list[Source]:
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()
    return search([str(folder)], DNGS).sources


def test_a_folder_s_frames_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    names = ("rose-2.dng", "rose-10.dng", "rose-1.DNG", "rose.truth.tif", "rose.motion.json")
    ordered = [str(tmp_path / name) for name in ("rose-1.DNG", "rose-2.dng", "rose-10.dng")]
    assert series(sources_in(tmp_path, *names)) == ordered


def test_files_that_are_named_are_taken_as_they_are() -> None:
    names = ["b.dng", "a-7.dng", "c/a-1.dng"]
    assert series(list(map(Source, names))) == names


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("a-1.dng a-2.dng dark.dng", "of 2: {0}/a-1.dng, {0}/dark.dng; name the files of one"),
        ("a-2.dng a-1.dng more/a-1.dng", "of 2: {0}/a-1.dng, {0}/more/a-1.dng; name"),
        ("a.dng b.dng c.dng d.dng e.dng f.dng", "of 6: .*, {0}/d.dng; name"),
    ],
)
def test_what_is_not_one_burst_is_named(tmp_path: Path, names: str, words: str) -> None:
    with pytest.raises(InputError, match=words.format(tmp_path)):
        series(sources_in(tmp_path, *names.split()))


@pytest.mark.parametrize(
    ("names", "stem"),
    [
        ("in/a-1.dng in/a-2.dng", "a"),
        ("b/a-7.dng c/a-1.dng", "a"),
        ("a-1.dng b.dng", "a-1"),
        ("b.dng a-1.dng", "b"),
        ("a-b-01.dng a-b-10.dng", "a-b"),
    ],
)
def test_a_picture_is_called_by_what_its_frames_have_in_common(names: str, stem: str) -> None:
    assert series_stem(names.split()) == stem
