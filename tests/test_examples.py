"""Every public name of the libraries, and of `panchroma` above them, shows its use in its docstring, and the example is true."""

import doctest
from pathlib import Path
from types import FunctionType, ModuleType

import pytest

import device
import offline
import panchroma
import shared

PUBLIC = [(module, name) for module in (shared, device, offline, panchroma) for name in module.__all__]
EXAMPLES = [(module, name) for module, name in PUBLIC if isinstance(getattr(module, name), FunctionType | type)]


@pytest.mark.parametrize(("module", "name"), EXAMPLES, ids=[f"{module.__name__}.{name}" for module, name in EXAMPLES])
def test_a_public_name_has_an_example_that_runs(
    module: ModuleType, name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)  # examples may write files
    documented = getattr(module, name)
    examples = doctest.DocTestFinder(recurse=False).find(documented, name, globs={})
    assert any(test.examples for test in examples), f"{module.__name__}.{name} has no example in its docstring"
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    said: list[str] = []
    for test in examples:
        runner.run(test, out=said.append)
    assert not runner.failures, "".join(said)
