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
        (b"", "the file is empty"),
        (b"# nothing but this\n\n", "is not the capital letters"),
        (b"W" * (1 << 17), "is larger than the 65536 bytes"),
    ],
)
def test_what_is_no_pattern_is_refused(tmp_path: Path, text: str | bytes, words: str) -> None:
    """Bytes are what a file holds, which is then named."""
    begin = "`pattern` "
    if isinstance(text, bytes):
        (tmp_path / "pattern.txt").write_bytes(text)
        text = str(tmp_path / "pattern.txt")
        begin = f"{text}: "
    with pytest.raises(InputError) as refused:
        read_pattern(text)
    assert str(refused.value).startswith(begin)
    assert words in str(refused.value)
    assert len(str(refused.value)) < 550


def test_a_folder_is_no_pattern(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a folder; give a pattern"):
        read_pattern(str(tmp_path))
