"""Names of tiles, wherever letters go."""

from pathlib import Path

import pytest

from shared import CfaPattern
from shared.errors import InputError
from shared.pattern_text import read_pattern
from shared.tiles import TILES, name_of


@pytest.mark.parametrize("name", TILES)
def test_a_name_is_as_good_as_letters(name: str) -> None:
    pattern = CfaPattern.of_letters(TILES[name])
    for written in (name.upper(), f" {name} "):
        assert CfaPattern.of_letters(written) == read_pattern(written) == pattern
    assert pattern.name == name
    assert CfaPattern(pattern.tile, (1, 2)).name == name
    assert name_of(pattern.letters_from((1, 1))) == name  # as a file written elsewhere may have it


@pytest.mark.parametrize(
    ("first", "green", "blue", "red"),
    [
        ("WBWG", (4, 7, 10, 13), (2, 5), (12, 15)),
        ("WGWB", (2, 5, 12, 15), (4, 7), (10, 13)),
        ("WRWG", (4, 7, 10, 13), (12, 15), (2, 5)),
        ("WGWR", (2, 5, 12, 15), (10, 13), (4, 7)),
    ],
)
def test_genicams_sparse_colour_filter_is_kodaks_tile(
    first: str, green: tuple[int, ...], blue: tuple[int, ...], red: tuple[int, ...]
) -> None:
    """Cells of the 4 x 4 tile, counted from 1 row by row, as PFNC 2.4, section 3.1.9, has them; all others are panchromatic."""
    letters = dict.fromkeys(green, "G") | dict.fromkeys(blue, "B") | dict.fromkeys(red, "R")
    cells = "".join(letters.get(cell, "W") for cell in range(1, 17))
    pattern = read_pattern(f"SCF1{first}")
    assert pattern == CfaPattern.of_letters(f"scf1{first}")
    assert (pattern.name, pattern.tile[0], "".join(pattern.tile)) == ("Kodak", first, cells)


def test_the_papers_blocks_are_named_by_their_period() -> None:
    for period in (3, 4, 8, 16):
        assert CfaPattern.of_letters(f"K={period}") == CfaPattern.of_letters(f"k = {period}") == CfaPattern.bayer(period)
        assert CfaPattern.bayer(period).name == f"K={period}"
    assert CfaPattern.of_letters("K=6").name == "paper"
    assert (CfaPattern.bayer(6, "GRBG").name, CfaPattern.of_letters("CMW/YWW/WWW").name) == ("", "")
    for none in ("K=2", "K=17", "K=0", "K="):
        with pytest.raises(InputError):
            CfaPattern.of_letters(none)


@pytest.mark.parametrize(("word", "likely"), [("kodac", "Kodak"), ("sonny", "Sony"), ("KAIZO", "Kaizu"), ("papr", "paper")])
def test_a_misspelt_name_is_recognised(word: str, likely: str) -> None:
    for parse in (CfaPattern.of_letters, read_pattern):
        with pytest.raises(InputError, match=f"kodak, sony, honda, kaizu, or K=4 .*; did you mean {likely}\\?"):
            parse(word)


def test_a_name_goes_before_a_file_or_folder_that_has_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as the folder of results that is named after the tile."""
    monkeypatch.chdir(tmp_path)
    Path("kodak").mkdir()
    Path("sony").write_text("RG/BW")
    assert read_pattern("kodak").name == "Kodak"
    assert read_pattern("sony").name == "Sony"
    assert read_pattern("./sony") == CfaPattern.of_letters("RG/BW")
