"""Which shots are one burst."""

from pathlib import Path

import pytest

from panchroma.shared.errors import InputError
from panchroma.tools.batch.burst import series, series_stem
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
        ("a-1.dng a-2.dng dark.dng", "found {0}/a-1.dng and 1 more, {0}/dark.dng; name the files"),
        ("a-1.dng b-1.dng b-2.dng", "found {0}/a-1.dng, {0}/b-1.dng and 1 more; name"),
        ("a-1.dng more/a-1.dng", "found {0}/a-1.dng, {0}/more/a-1.dng; name"),
        ("a.dng b.dng c.dng d.dng e.dng f.dng", "{0}/d.dng and 2 others; name"),
    ],
)
def test_what_is_not_one_burst_is_named(tmp_path: Path, names: str, words: str) -> None:
    with pytest.raises(InputError, match=words.format(tmp_path)):
        series(sources_in(tmp_path, *names.split()))


@pytest.mark.parametrize("spelling", ["./a.dng", "hard.dng", "b-2.dng"])
def test_a_file_that_is_given_twice_under_other_names(tmp_path: Path, spelling: str) -> None:
    (tmp_path / "a.dng").write_text("a")
    (tmp_path / "b-2.dng").symlink_to("a.dng")
    (tmp_path / "hard.dng").hardlink_to(tmp_path / "a.dng")
    first, second = f"{tmp_path}/a.dng", f"{tmp_path}/{spelling}"
    message = f"^{second}: is given twice: it is the same file as {first}$"
    with pytest.raises(InputError, match=message):
        series([Source(first), Source("missing.dng"), Source(second)])


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
