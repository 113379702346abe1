"""The notebook in `tools/notebook` runs from its first cell to its last, and what a cell ends with
shows itself.
"""

import ast
import json
from pathlib import Path
from typing import Any

import pytest

from tests.data import ROOT

NOTEBOOK = json.loads((ROOT / "tools/notebook/first_steps.ipynb").read_text("utf-8"))
CELLS = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


def run(cell: str, names: dict[str, Any]) -> Any:
    """Run a cell, as a notebook does, and return the value of its last expression; None if it ends
    with a statement.
    """
    tree = ast.parse(cell)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    if not isinstance(last, ast.Expr):
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


def test_every_cell_runs_and_shows_its_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    # a smaller scene, for the sake of time
    cells = ("".join(cell["source"]).replace("1800x1200", "240x160") for cell in CELLS)
    values = [run(cell, names) for cell in cells]
    shown = [type(value).__name__ for value in values if hasattr(value, "_repr_png_")]
    assert shown == ["Shot", "Picture", "Image", "Shot", "Picture"]
    assert {path.name for path in tmp_path.iterdir()} == {"leaves.dng", "leaves.tif"}


def test_it_is_kept_without_outputs() -> None:
    assert CELLS
    assert not any(cell["outputs"] or cell["execution_count"] for cell in CELLS)
