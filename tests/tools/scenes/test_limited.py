"""A call in a process with limits returns, raises, or is ended."""

import os
from pathlib import Path

import pytest

from shared.errors import InputError
from tools.scenes.limited import run_limited


def _answer(path: Path, what: str) -> str:
    match what:
        case "refuse":
            raise InputError("is odd")
        case "spin":
            while True:
                pass
        case "swell":
            return str(len(bytearray(1 << 30)))
        case "crash":
            os.abort()
    print("a library prints")
    return f"{path.name} {what}"


def test_the_result_comes_back(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"1")
    assert run_limited(tmp_path / "a", ("time",), _answer, tmp_path / "a", "read") == "a read"


@pytest.mark.parametrize(
    ("what", "said"), [("refuse", "is odd"), ("spin", "0.25 s"), ("swell", "192 MB"), ("crash", "ends the process")]
)
def test_what_exceeds_its_limits_is_refused(tmp_path: Path, what: str, said: str) -> None:
    (tmp_path / "a").write_bytes(b"1")
    with pytest.raises(InputError, match=said):
        run_limited(tmp_path / "a", (), _answer, tmp_path / "a", what)
