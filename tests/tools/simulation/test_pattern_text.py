"""Patterns as a user writes them: letters, names of tiles, and files with either."""

from pathlib import Path

import pytest

from panchroma.shared import CfaPattern, InputError
from panchroma.tools.simulation.pattern_text import read_pattern

KODAK = "WBWG/BWGW/WGWR/GWRW"


@pytest.mark.parametrize(
    "text",
    [
        *(KODAK, KODAK.replace("/", "\n"), f"{KODAK}/\n", "kodak\n"),
        "# Kodak\nWBWG\n\n BW GW # second row\r\n\tWGWR/GWRW\n",
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
    assert len(str(refused.value)) < 550


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the file is empty"),
        (b"# nothing but this\n\n", "is not the capital letters"),
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
