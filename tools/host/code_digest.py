"""Digest of the code that a result depends on: the files and folders that its method names."""

import ast
import hashlib
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).parents[2]
_DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


@cache
def digest(*places: str) -> str:
    """Digest of source files: 16 hexadecimal digits.

    places: files and folders, relative to the folder that holds `shared` and `tools`. A folder stands for everything below it but
    texts (*.md) and compiled code. Docstrings, comments and layout of Python files do not count.
    Raises FileNotFoundError when there is no such place.
    """
    total = hashlib.sha256()
    for path in sorted({path for place in places for path in _files(_ROOT / place)}):
        content = path.read_bytes()
        total.update(path.relative_to(_ROOT).as_posix().encode() + b"\0")
        total.update(hashlib.sha256(_code(content) if path.suffix == ".py" else content).digest())
    return total.hexdigest()[:16]


def _files(place: Path) -> list[Path]:
    if not place.is_dir():
        return [place]
    return [path for path in place.rglob("*") if path.is_file() and path.suffix != ".md" and "__pycache__" not in path.parts]


def _code(source: bytes) -> bytes:
    """The syntax tree of a module without its docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            del node.body[0]
    return ast.dump(tree).encode()
