"""Every public name of the libraries, and of `panchroma` above them, shows its use in its
docstring; all examples are true.
"""

import doctest
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType

import pytest

import panchroma
from panchroma import device, offline, shared
from panchroma.device import capture
from panchroma.offline import burst
from tests.test_architecture import sources

MODULES = shared, device, capture, offline, burst, panchroma
PUBLIC = [(module, name) for module in MODULES for name in module.__all__]
EXAMPLES = [
    (module, name)
    for module, name in PUBLIC
    if isinstance(getattr(module, name), FunctionType | type)
]


@pytest.mark.parametrize(
    ("module", "name"), EXAMPLES, ids=[f"{module.__name__}.{name}" for module, name in EXAMPLES]
)
def test_a_public_name_has_an_example(module: ModuleType, name: str) -> None:
    found = doctest.DocTestFinder(recurse=False).find(getattr(module, name), name, globs={})
    assert any(test.examples for test in found), (
        f"{module.__name__}.{name} has no example in its docstring"
    )


@pytest.mark.parametrize("name", [name for name, text in sources() if ">>> " in text])
def test_the_examples_of_a_module_are_true(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    if name.startswith("panchroma.offline."):
        # an example shows what is said of compiling: nothing, where all is done
        request.getfixturevalue("compiled")
    module = import_module(name.removesuffix(".__init__"))
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    said: list[str] = []
    for number, test in enumerate(doctest.DocTestFinder().find(module)):
        folder = tmp_path / str(number)  # examples may write files
        folder.mkdir()
        monkeypatch.chdir(folder)
        runner.run(test, out=said.append)
    assert not runner.failures, "".join(said)
