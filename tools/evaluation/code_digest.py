"""What a result depends on: the definitions of ours that a function can reach, found in the source without running it.

A result is kept until one of them changes. Comments, docstrings, layout, and whatever else stands in the same files do not count.
"""

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).parents[2]
_OURS = ("shared", "device", "offline", "tools")
_Function = ast.FunctionDef | ast.AsyncFunctionDef
_Import = tuple[str, str]  # a module, and a name in it ("" = the module itself)


@cache
def digest(*entries: str) -> str:
    """Of all that these can reach; an entry is "package.module:name", or "package.module:Class.method".

    Of a class its fields and special methods count, and those methods whose names occur as attributes in what is reached. Names
    are followed through imports, annotations and default values. Too much may be reached, never too little, as long as names are
    not put together at run time.
    """
    total = hashlib.sha256()
    for text in sorted(_Walk(entries).texts):
        total.update(text.encode() + b"\0")
    return total.hexdigest()[:16]


class _Walk:
    """From the entries to everything they can reach; texts: of each definition, with the module it is in; reached: the names."""

    def __init__(self, entries: tuple[str, ...]) -> None:
        self.texts: set[str] = set()
        self.reached: set[_Import] = set()
        self._attributes: set[str] = set()
        self._methods: dict[str, list[tuple[str, _Function]]] = {}  # of reached classes, not called by anything reached so far
        self._next: list[_Import] = []
        for entry in entries:
            module, _, name = entry.partition(":")
            name, _, method = name.partition(".")
            if name not in _source(module).definitions:
                raise ValueError(f"{entry}: there is no such definition")
            self._reach(module, name)
            self._attribute(method)
        while self._next:
            self._follow(*self._next.pop())

    def _reach(self, module: str, name: str) -> None:
        if name and (module, name) not in self.reached:
            self.reached.add((module, name))
            self._next.append((module, name))

    def _follow(self, module: str, name: str) -> None:
        source = _source(module)
        for target in source.imports.get(name, ()):
            self._reach(*target)
        for node in source.definitions.get(name, ()):
            self._definition(module, node)

    def _definition(self, module: str, node: ast.stmt) -> None:
        if not isinstance(node, ast.ClassDef):
            self._text(module, node)
            return
        special = [each for each in node.body if not isinstance(each, _Function) or each.name.startswith("__")]
        for each in node.body:
            if isinstance(each, _Function) and each not in special:
                if each.name in self._attributes:
                    self._text(module, each)
                else:
                    self._methods.setdefault(each.name, []).append((module, each))
        self._text(module, ast.ClassDef(node.name, node.bases, node.keywords, special or [ast.Pass()], node.decorator_list))

    def _text(self, module: str, node: ast.stmt) -> None:
        self.texts.add(f"{module}: {ast.unparse(_without_docstrings(node))}")
        imported = {**_source(module).imports, **{name: [target] for name, target in _imports(module, node)}}
        for each in _nodes(node):
            if isinstance(each, ast.Name):
                for target in imported.get(each.id, [(module, each.id)]):
                    self._reach(*target)
            elif isinstance(each, ast.Attribute):
                self._attribute(each.attr)
                for origin, name in imported.get(getattr(each.value, "id", ""), ()):
                    if _path(whole := f"{origin}.{name}".rstrip(".")):  # an attribute of a module is a name in it
                        self._reach(whole, each.attr)

    def _attribute(self, name: str) -> None:
        if name not in self._attributes:
            self._attributes.add(name)
            for module, method in self._methods.pop(name, ()):
                self._text(module, method)


class _Source:
    """The names at the top of a module: where they are imported from, and the statements that define them."""

    def __init__(self, module: str) -> None:
        self.imports: dict[str, list[_Import]] = {}
        self.definitions: dict[str, list[ast.stmt]] = {}
        path = _path(module)
        if path is not None:
            self._add(module, ast.parse(path.read_bytes()).body)

    def _add(self, module: str, body: list[ast.stmt]) -> None:
        for node in body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                for name, target in _imports(module, node):
                    self.imports.setdefault(name, []).append(target)
            elif isinstance(node, ast.If | ast.Try | ast.With):
                for part in ("body", "orelse", "finalbody"):
                    self._add(module, getattr(node, part, []))
            elif isinstance(node, ast.ClassDef | _Function):
                self.definitions.setdefault(node.name, []).append(node)
            else:
                for each in ast.walk(node):
                    if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store):
                        self.definitions.setdefault(each.id, []).append(node)


_source = cache(_Source)


def _imports(module: str, node: ast.AST) -> Iterator[tuple[str, _Import]]:
    """(name, what it stands for) of every import of ours in a statement."""
    for each in ast.walk(node):
        if isinstance(each, ast.ImportFrom):
            path = _path(module)
            package = module.split(".") if path and path.name == "__init__.py" else module.split(".")[:-1]
            base = package[: len(package) - each.level + 1] if each.level else []
            origin = ".".join([*base, *(each.module or "").split(".")]).strip(".")
            if origin.partition(".")[0] in _OURS:
                yield from ((alias.asname or alias.name, (origin, alias.name)) for alias in each.names)
        elif isinstance(each, ast.Import):
            for alias in each.names:
                if alias.name.partition(".")[0] in _OURS:
                    yield alias.asname or alias.name.partition(".")[0], (alias.name, "")


@cache
def _path(module: str) -> Path | None:
    place = _ROOT.joinpath(*module.split("."))
    return next((path for path in (place / "__init__.py", place.with_suffix(".py")) if path.is_file()), None)


def _nodes(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes, those in quoted annotations too."""
    for each in ast.walk(node):
        yield each
        for annotation in (getattr(each, "annotation", None), getattr(each, "returns", None)):
            for part in ast.walk(annotation) if annotation is not None else ():
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    yield from ast.walk(ast.parse(part.value, mode="eval"))


def _without_docstrings(node: ast.stmt) -> ast.stmt:
    for each in ast.walk(node):
        if isinstance(each, ast.ClassDef | _Function) and ast.get_docstring(each, clean=False) is not None:
            each.body = each.body[1:] or [ast.Pass()]
    return node
