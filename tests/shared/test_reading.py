import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from panchroma.shared.errors import ConvergenceError, InputError, MissingFileError, OutputError
from panchroma.shared.figures import parsed_json
from panchroma.shared.pattern import CfaPattern
from panchroma.shared.reading import opened_file, read_text, read_whole
from panchroma.shared.shading import Shading


def test_a_file_within_its_bound_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_whole(path, 5, "a text") == b"12345"
    assert read_whole(str(path), 6, "a text") == b"12345"
    with pytest.raises(InputError, match="is larger than the 4 bytes of a text"):
        read_whole(path, 4, "a text")
    with opened_file(path, 5, "a text") as file:
        path.write_bytes(b"1234567890")  # it grows meanwhile
        assert file.read(5) == b"12345"


def test_what_is_no_file_is_told(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "empty").touch()
    said = {"pipe": "is a pipe", "empty": "is empty", ".": "is a folder", "absent": "no such file"}
    for name, words in said.items():
        with pytest.raises(InputError, match=words):
            read_whole(tmp_path / name, 5, "a text")
    with pytest.raises(InputError, match="cannot be read"):
        read_whole("nul\0", 5, "a text")


def test_faults_of_the_reader_are_not_taken_for_those_of_the_disk(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12345")
    with pytest.raises(ValueError, match="ours"), opened_file(tmp_path / "a", 5, "a text"):
        raise ValueError("ours")
    unreadable = pytest.raises(InputError, match="cannot be read")
    with unreadable, opened_file(tmp_path / "a", 5, "a text"):
        raise OSError(5, "Input/output error")


@pytest.mark.parametrize("text", ["a", "ä\n", ""])
def test_a_byte_order_mark_is_no_part_of_a_text(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(text.encode("utf-8-sig"))
    assert read_text(path, 99, "a text") == text


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_other_encodings_are_refused_with_the_remedy(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes("some text".encode(encoding))
    with pytest.raises(InputError, match=r"\(it may be UTF-16\); save a list as UTF-8$"):
        read_text(path, 99, "a list", otherwise="latin-1")
    path.write_bytes("\xe4".encode("latin-1"))
    assert read_text(path, 99, "a list", otherwise="latin-1") == "\xe4"
    with pytest.raises(InputError, match="is not a text in UTF-8; save a list as UTF-8"):
        read_text(path, 99, "a list")


def test_errors_are_those_of_python_too(tmp_path: Path) -> None:
    """Programs that know nothing of Panchroma catch them, and they pass between processes."""
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_whole(tmp_path / "missing", 9, "a text")
    for kind, base in (
        (InputError, ValueError),
        (MissingFileError, ValueError),
        (OutputError, OSError),
        (ConvergenceError, ArithmeticError),
    ):
        passed = pickle.loads(pickle.dumps(kind("x: is odd")))
        assert isinstance(passed, base)
        assert (type(passed), str(passed)) == (kind, "x: is odd")


@pytest.mark.parametrize(
    ("refused", "words"),
    [
        (lambda: parsed_json('{"gamma": 1e999}'), "^holds '1e999', which is not a finite number"),
        (lambda: CfaPattern.from_json({"tile": ["RG", "GB"], "origin": [0.5, 0]}), "origin is 0.5"),
        (lambda: Shading(cast(Any, "x"), (9, 9)), "^shading: gain"),
    ],
)
def test_a_reason_within_a_reason_is_kept(refused: Callable[[], object], words: str) -> None:
    """An InputError is a ValueError, and is not taken for one of the library's beside it."""
    with pytest.raises(InputError, match=words):
        refused()
