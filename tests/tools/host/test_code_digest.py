"""What a kept result depends on: every file that its method names, and a method names every file that it needs."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.data import ROOT
from tests.test_architecture import imported, sources
from tools.evaluation.methods import MEASURING, methods
from tools.host import code_digest
from tools.host.code_digest import digest

TREE = {
    "offline/entry.py": '"""A module."""\n\n\ndef look(scene):\n    """Look."""\n    return scene\n',
    "offline/kernels/blur.py": "WIDTH = 3\n",
    "device/models/graph.onnx": "graph",
    "tools/rival.py": "def demosaic(samples):\n    return samples\n",
}
PLACES = ("offline", "device", "tools/rival.py")


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A small tree of sources that stands for ours."""
    monkeypatch.setattr(code_digest, "_ROOT", tmp_path)
    for name, text in TREE.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    digest.cache_clear()
    yield tmp_path
    digest.cache_clear()


@pytest.mark.parametrize(
    ("name", "text", "counts"),
    [
        ("offline/entry.py", "def look(scene):\n    return -scene\n", True),
        ("offline/kernels/blur.py", "WIDTH = 5\n", True),
        ("offline/kernels/new.py", "", True),
        ("device/models/graph.onnx", "another graph", True),
        ("tools/rival.py", "def demosaic(samples):\n    return samples + 1\n", True),
        (
            "offline/entry.py",
            '"""Other words."""\n# a remark\ndef look( scene ):\n    """More\n    words."""\n    return (scene)\n',
            False,
        ),
        ("offline/README.md", "words", False),
        ("offline/kernels/__pycache__/blur.cpython-313.pyc", "compiled", False),
        ("tools/other.py", "ANYTHING = 1\n", False),
        ("shared/other.py", "ANYTHING = 1\n", False),
    ],
)
def test_code_in_the_named_places_counts_and_nothing_else(tree: Path, name: str, text: str, counts: bool) -> None:
    before = digest(*PLACES)
    (tree / name).parent.mkdir(exist_ok=True)
    (tree / name).write_text(text)
    digest.cache_clear()
    assert (digest(*PLACES) != before) == counts


def test_a_file_counts_under_its_name(tree: Path) -> None:
    before = digest("offline")
    (tree / "offline/entry.py").rename(tree / "offline/renamed.py")
    digest.cache_clear()
    assert digest("offline") != before


def test_a_place_that_does_not_exist_is_an_error() -> None:
    with pytest.raises(FileNotFoundError):
        digest("tools/evaluation/nothing.py")


def module_files() -> dict[str, Path]:
    """The file of each module of ours; a package is its `__init__`."""
    return {module.removesuffix(".__init__"): Path(*module.split(".")).with_suffix(".py") for module, _ in sources()}


FILES = module_files()
UNINVOLVED = {Path("tools/host/font_folder.py")}  # says where a package may keep a list of fonts: no result depends on it


@cache
def needed(file: Path) -> frozenset[Path]:
    """The files of ours that importing a file runs: what it imports, wherever it does, and the packages these are in."""
    parts = file.with_suffix("").parts
    prefixes = [tuple(name.split(".")) for name in imported(".".join(parts), (ROOT / file).read_text("utf-8"))]
    modules = {".".join(name[:length]) for name in [*prefixes, parts] for length in range(1, len(name) + 1)}
    return frozenset(FILES[module] for module in modules & FILES.keys())


def forgotten(*places: str) -> set[Path]:
    """Files with code that files at these places import, and that are not there themselves."""
    named = {path.relative_to(ROOT) for place in places for path in code_digest._files(ROOT / place)}
    missing = {each for file in named if file.suffix == ".py" for each in needed(file)} - named - UNINVOLVED
    return {each for each in missing if code_digest._code((ROOT / each).read_bytes()) != code_digest._code(b"")}


@pytest.mark.parametrize("name", methods())
def test_a_method_names_every_file_that_it_needs(name: str) -> None:
    """Whatever the named files import is named, and so is the method's own module: too much may count, never too little."""
    method = methods()[name]
    functions = [getattr(method.function, "func", method.function), method.denoise]
    assert {str(FILES[function.__module__]) for function in functions if function} <= set(method.code)
    assert forgotten(*MEASURING, *method.code) == set()


def test_a_forgotten_file_is_found() -> None:
    assert forgotten("tools/evaluation/rivals/packages.py", "shared") == {
        Path("tools/evaluation/rivals", name) for name in ("bayer.py", "integers.py")
    }
    assert Path("offline/render.py") in forgotten("tools/evaluation/presets.py", "shared")


@pytest.mark.parametrize("name", [name for name, method in methods().items() if not method.ours])
def test_a_rivals_result_survives_a_change_of_ours(name: str) -> None:
    assert not [place for place in methods()[name].code if not place.startswith("tools/evaluation/rivals/")]
    assert not [place for place in MEASURING if place.startswith(("offline", "device"))]
