"""Which package may import which, and which layer of `tools` may import which: every arrow points
down.

The imports are read from the source, those inside functions too.
"""

import ast
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter

import pytest

from tests.data import ROOT

MAY_IMPORT = {
    "shared": {"shared"},
    "device": {"device", "shared"},
    "offline": {"offline", "shared"},
    "tools": {"tools", "device", "offline", "shared"},
}
# The layers of `tools`, from the ground up: a module imports from its own layer and from those
# below.
LAYERS = (
    {"io", "simulation"},
    {"batch", "calibration", "evaluation", "capture", "training"},
    {"cli", "commands", "notebook", "pages"},
)
LAYER_OF = {name: height for height, layer in enumerate(LAYERS) for name in layer}
LOWER = ("shared", "device", "offline", "reference")  # folders of tests that import no tools
FACADE = "panchroma.tools.notebook.panchroma."  # where its files lie
FORWARD = (  # but for what makes and shows their pictures
    "panchroma.tools.simulation.sensor",
    "panchroma.tools.io.display",
    "panchroma.tools.io.colour",
)
# A camera installs these and nothing else. The off-camera render needs SciPy and Numba besides,
# bursts OpenCV.
CAMERA = {"numpy", "tifffile", "imagecodecs", "onnxruntime"}
THIRD_PARTY = {
    "shared": CAMERA,
    "device": CAMERA,
    "offline": CAMERA | {"scipy", "numba", "llvmlite", "cv2"},
}
# Packages that only these modules, and what is below them, may import.
ONLY_IN = {
    "onnx": ("panchroma.tools.training",),
    "numba": ("panchroma.offline.numerics",),
    "llvmlite": ("panchroma.offline.numerics",),
    "onnxruntime": ("panchroma.shared.runtime",),
    "gi": ("panchroma.tools.capture.genicam",),
}


@cache
def sources() -> list[tuple[str, str]]:
    """(dotted name, text) of every module of the four packages and of the facade."""
    paths = [
        path.relative_to(ROOT)
        for package in MAY_IMPORT
        for path in sorted((ROOT / package).rglob("*.py"))
    ]
    names = ("panchroma." + ".".join(path.with_suffix("").parts) for path in paths)
    texts = ((ROOT / path).read_text(encoding="utf-8") for path in paths)
    return [
        (name.replace(FACADE, "panchroma."), text) for name, text in zip(names, texts, strict=True)
    ]


@cache
def nodes(text: str) -> list[ast.AST]:
    """The syntax tree of a module, every node of it."""
    return list(ast.walk(ast.parse(text)))


def imported(module: str, text: str) -> Iterator[str]:
    """The absolute dotted names of everything that a module imports, at any depth of its code."""
    for node in nodes(text):
        match node:
            case ast.Import(names=names):
                yield from (name.name for name in names)
            case ast.ImportFrom(module=source, names=names, level=level):
                base = module.split(".")[:-level] if level else []
                base += source.split(".") if source else []
                yield from (".".join([*base, name.name]) for name in names)
            case ast.Call(
                func=ast.Name(id="import_module" | "__import__")
                | ast.Attribute(attr="import_module"),
                args=[ast.Constant(value=str(name)), *_],
            ):
                yield name


def place(name: str) -> tuple[str, str]:
    """The package of a module, and its room if the package is `tools`; the facade is the room
    `notebook`.
    """
    top, *below = name.split(".")
    if top != "panchroma":
        return top, ""
    if below and below[0] in MAY_IMPORT:
        return below[0], below[1] if below[0] == "tools" and len(below) > 1 else ""
    return "tools", "notebook"


def violations(module: str, text: str) -> list[str]:
    """A line for each import of a module that is not allowed."""
    package, room = place(module)
    found = []
    for name in imported(module, text):
        target, other_room = place(name)
        ours = name.partition(".")[0] == "panchroma"
        if target == "tests" or (ours and target not in MAY_IMPORT[package]):
            allowed = ", ".join(sorted(MAY_IMPORT[package]))
            found.append(f"{module} imports {name}: {package} may import only {allowed}")
        elif ours and LAYER_OF.get(other_room, 0) > LAYER_OF.get(room, len(LAYERS)):
            found.append(f"{module} imports {name}, which is in a layer above")
        elif target in ONLY_IN and not any(
            f"{module}.".startswith(f"{home}.") for home in ONLY_IN[target]
        ):
            found.append(f"{module} imports {name}: only {', '.join(ONLY_IN[target])} may")
        elif not ours and target not in {
            *sys.stdlib_module_names,
            *ONLY_IN,
            *THIRD_PARTY.get(package, {target}),
        }:
            allowed = ", ".join(sorted(THIRD_PARTY[package]))
            found.append(f"{module} imports {name}: {package} may use only {allowed}")
    return found


def circle(texts: dict[str, str]) -> list[str]:
    """Modules of which each imports another, for types or in a function too, and the last is the
    first; [] if there are none.
    """

    def module(name: str) -> str:
        places = (name, f"{name}.__init__", up := name.rpartition(".")[0], f"{up}.__init__")
        return next((place for place in places if place in texts), "")

    graph = {
        name: {module(other) for other in imported(name, text)} - {name, ""}
        for name, text in texts.items()
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_every_arrow_is_in_the_diagram() -> None:
    assert [fault for module, text in sources() for fault in violations(module, text)] == []


def test_no_modules_import_each_other() -> None:
    texts = dict(sources())
    assert circle(texts) == []
    console = "panchroma.tools.batch.console"
    texts["panchroma.tools.batch.progress"] += "if TYPE_CHECKING:\n    from .console import LOG\n"
    assert {*circle(texts)} == {console, "panchroma.tools.batch.progress"}


def test_every_module_of_tools_is_in_a_layer() -> None:
    rooms = {
        room for package, room in (place(module) for module, _ in sources()) if package == "tools"
    }
    assert rooms - {"__init__"} == set(LAYER_OF)


def test_lower_floors_are_tested_without_the_upper_one() -> None:
    """Nor do the modules of other tests that they import."""
    paths = (ROOT / "tests").rglob("*.py")
    texts = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): path.read_text("utf-8")
        for path in paths
    }
    texts |= {module: text for module, text in sources() if module in FORWARD}
    waiting = [*FORWARD, *sorted(name for name in texts if name.split(".")[1] in LOWER)]
    assert len(waiting) > 60
    found = []
    for name in waiting:  # which grows
        others = list(imported(name, texts[name]))
        above = (each for each in others if "tools" in each.split(".")[:3])
        found += [f"{name} imports {each}" for each in above if not each.startswith(FORWARD)]
        modules = {place for each in others for place in (each, each.rpartition(".")[0])}
        waiting += (modules & texts.keys()).difference(waiting)
    assert found == []


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("panchroma.offline.pipeline", "def later():\n    from ..tools.cli import main"),
        ("panchroma.offline.numerics.solver", "from tests.reference import affinity"),
        ("panchroma.offline.stages.affinity", "from numba import njit"),
        ("panchroma.shared.pattern", "importlib.import_module('panchroma.offline.pipeline')"),
        ("panchroma.device.preview", "__import__('scipy')"),
        ("panchroma.tools.io.picture", "from ..batch.jobs import own_file"),
        ("panchroma.tools.batch.run", "from panchroma import shots"),
    ],
)
def test_a_planted_import_is_caught(module: str, text: str) -> None:
    assert len(violations(module, text)) == 1
