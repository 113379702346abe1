"""The digest of code: what it depends on."""

from collections.abc import Iterator
from pathlib import Path

import pytest

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
