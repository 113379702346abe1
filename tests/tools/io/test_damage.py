"""A fault of the program is no damage of a file: only what decoding libraries raise is called so."""

import operator
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from panchroma.shared import InputError, read_dng
from panchroma.shared.dng import verify_dng
from panchroma.tools.io import camera_raw, decoders, limited
from panchroma.tools.io.damage import guarded
from panchroma.tools.simulation.load import load_scene
from tests.fuzz.corpus import Sample, corpus

OURS = str(Path(camera_raw.__file__).parents[2])
SCENES = [sample for sample in corpus() if sample.suffix not in (".json", ".ti3", ".raw")]
ONE_OF_EACH = {(sample.kind, sample.kind == "linear DNG" and sample): sample for sample in SCENES}


class PlantedError(Exception):
    """What no code of ours expects."""


@contextmanager
def calls(entered: Callable[[CodeType], None]) -> Iterator[None]:
    """Tell of each function of Panchroma that is entered; what `entered` raises is raised there."""

    def profile(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        is_named = not code.co_name.startswith("<")  # a comprehension is part of its function
        if event == "call" and is_named and code.co_filename.startswith(OURS):
            entered(code)

    sys.setprofile(profile)
    try:
        yield
    finally:
        sys.setprofile(None)


def in_this_process(_: Path, __: Any, function: Any, *arguments: Any) -> Any:
    return function(*arguments)


@pytest.mark.parametrize("sample", ONE_OF_EACH.values(), ids=lambda sample: sample.kind)
def test_a_fault_of_any_function_is_no_damage(
    sample: Sample, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every function of Panchroma that runs while a file is decoded fails once."""
    monkeypatch.setattr(camera_raw, "run_limited", in_this_process)
    monkeypatch.setattr(decoders, "run_limited", in_this_process)
    path, found = tmp_path / f"file{sample.suffix}", list[CodeType]()
    path.write_bytes(sample.data)
    read: Any = verify_dng if sample.sealed else sample.read
    with calls(found.append):
        read(path)
    assert len(set(found)) > 8
    for code in set(found):

        def fail(entered: CodeType, code: CodeType = code) -> None:
            if entered is code:
                raise PlantedError

        with pytest.raises(PlantedError), calls(fail):
            read(path)


def test_what_the_library_lacks_is_no_damage_but_what_it_raises_is() -> None:
    """An attribute that an older release does not have."""
    with pytest.raises(AttributeError, match="raw_type"), guarded():
        camera_raw._check_mosaic(SimpleNamespace(), "")
    with pytest.raises(InputError, match="raw_type"), guarded():
        operator.attrgetter("raw_type")(SimpleNamespace())


def test_damage_keeps_its_cause(tmp_path: Path) -> None:
    for sample in SCENES:
        path = tmp_path / f"file{sample.suffix}"
        path.write_bytes(sample.data[: len(sample.data) * 2 // 3])
        read: Any = read_dng if sample.sealed else sample.read
        with pytest.raises(InputError) as raised:
            read(path)
        if "cannot be decoded" in str(raised.value):
            assert raised.value.__cause__ is not None
            assert not isinstance(raised.value.__cause__, InputError)


def fail(path: str) -> Any:
    """In a limited process."""
    raise KeyError("planted" if path else 1) from ValueError("deeper")


def test_a_fault_in_a_limited_process_is_one_here_with_its_traceback(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"x")
    with pytest.raises(RuntimeError, match="KeyError: 'planted'") as raised:
        limited.run_limited(tmp_path / "x", (), fail, "x")
    assert "in fail" in str(raised.value.__cause__)
    assert "ValueError: deeper" in str(raised.value.__cause__)


def test_a_package_that_is_not_installed_is_no_damage(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"x")
    with pytest.raises(ModuleNotFoundError) as raised:
        limited.run_limited(tmp_path / "x", ("no_such_package",), fail, "x")
    assert raised.value.name == "no_such_package"


def test_a_scene_that_is_gone_meanwhile_is_not_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.npy"
    np.save(path, np.ones((2, 2)))

    def remove(*_: Any) -> int:
        path.unlink()
        return path.stat().st_size

    monkeypatch.setattr(decoders, "data_bytes", remove)
    with pytest.raises(InputError, match=r"^cannot be read \(No such file"):
        load_scene(str(path))
