"""Patterns as a user writes them: letters, names of tiles, and files with either."""

from pathlib import Path

import pytest

from shared import CfaPattern
from shared.errors import InputError
from shared.tiles import TILES, name_of
from tools.simulation.pattern_text import read_pattern

KODAK = "WBWG/BWGW/WGWR/GWRW"


@pytest.mark.parametrize(
    "text",
    [
        *(KODAK, KODAK.replace("/", "\n"), "# Kodak\nWBWG\n\n BW GW # second row\r\n\tWGWR/GWRW\n", f"{KODAK}/\n"),
        *(f"\ufeff{KODAK}", "\ufeff# as Notepad saves it\r\nWBWG/BWGW/WGWR/GWRW\r\n", "kodak\n"),
    ],
)
def test_a_file_is_read_as_letters_are(tmp_path: Path, text: str) -> None:
    path = tmp_path / "KODAK"  # a name that could be letters
    path.write_text(text)
    assert read_pattern(str(path)) == CfaPattern.of_letters(KODAK) == read_pattern(KODAK)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rgww/gbww/wwww/wwww", "'rgww/gbww/wwww/wwww': is not the capital letters"),
        ("patern.txt", "and no file has this name"),
        ("", "'': is not the capital letters"),
        ("RGWW/GBW", "differ in length"),
        ("RGWW/GBWW/" * 10**5, "1000000 letters are more than the largest tile has, 16 x 16"),
        (300 * "x" + ".txt", "no file has this name"),
    ],
)
def test_what_is_no_pattern_is_refused(text: str, words: str) -> None:
    with pytest.raises(InputError) as refused:
        read_pattern(text)
    assert str(refused.value).startswith("`pattern` ")
    assert words in str(refused.value)
    assert len(str(refused.value)) < 500


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the file is empty"),
        (b"# nothing but this\n\n", "is not the capital letters"),
        (b"\xff\xfeR\0G\0", "is not a text in UTF-8 (it may be UTF-16); save a pattern as UTF-8"),
        (b"W" * (1 << 17), "is larger than the 65536 bytes"),
    ],
)
def test_a_file_without_a_pattern_is_named(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "pattern.txt"
    path.write_bytes(content)
    with pytest.raises(InputError) as refused:
        read_pattern(str(path))
    assert str(refused.value).startswith(f"{path}: ")
    assert words in str(refused.value)
    with pytest.raises(InputError, match="is a folder; give a pattern"):
        read_pattern(str(tmp_path))


# --- names of tiles, wherever letters go ---------------------------------------------------------------------------------------


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
