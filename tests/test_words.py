"""One word for one thing (shared/glossary.md): no name in the program holds a word that
has had several meanings. Only names that a file defines count; prose has its parts and pieces.
"""

import ast
import re
from pathlib import Path

import pytest

from tests.data import ROOT

PROGRAM = "offline", "device", "shared", "tools"
# Forbidden word -> the folders and files in which it is right.
RIGHT: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("cell", "core", "domain", "piece", "region"), ()),
    "part": ("tools/io/decoders.py",),  # of an OpenEXR file
    "tile": ("shared", "device/preview/contract.py", "tools"),  # of a pattern; of a TIFF, of a DNG
    # a calibrated illuminant (`lights` of camera.json), a setting of pooling; `tools` make light
    "light": ("shared", "tools", "offline/stages/pooling.py"),
}


def defined(text: str) -> set[str]:
    """The names of classes, functions, parameters, variables and attributes that code defines."""
    names = set[str]()
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name) | ast.arg(arg=name):
                names.add(name)
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                names.add(name)
    return names


def violations(path: Path, text: str) -> list[str]:
    """The name of a file, and those that it defines, with a word that is not right there."""
    places = {path.as_posix(), *(folder.as_posix() for folder in path.parents)}
    wrong = {word for word, right in RIGHT.items() if places.isdisjoint(right)}
    return [
        f"{path}: {name}"
        for name in sorted({path.stem, *defined(text)})
        for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)
        if word.lower().removesuffix("s") in wrong
    ]


def test_names_hold_no_word_of_several_meanings() -> None:
    paths = [path for room in PROGRAM for path in sorted((ROOT / room).rglob("*.py"))]
    assert len(paths) > 200
    texts = ((path.relative_to(ROOT), path.read_text("utf-8")) for path in paths)
    assert [name for path, text in texts for name in violations(path, text)] == []


@pytest.mark.parametrize("code", ["class Parts: ...", "def f(cell): ...", "a.CORE_ = light = 1"])
def test_planted_names_are_found(code: str) -> None:
    assert len(violations(Path("offline/a.py"), code)) == 1 + code.count("light")
    assert violations(Path("offline/a.py"), "path.parts") == []
