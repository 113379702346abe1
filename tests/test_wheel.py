"""The wheel: every module and every file that the program reads is in it, and it works where there
is no clone.
"""

import json
import shutil
from pathlib import Path
from shlex import quote
from zipfile import ZipFile

import pytest

from panchroma.tools.io.versions import install_command
from tests.data import ROOT
from tests.python import run_python

PACKAGES = ("shared", "device", "offline", "tools")
_FACADE = Path("tools/notebook/panchroma")
# For people who read the sources: texts, and pictures in texts.
_READ = {".md", ".png", ".jpg"}
_BUILD = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
# No render: it would be compiled again, at another place.
_USE = """
import sys
sys.path.insert(0, sys.argv[1])
import panchroma, panchroma.offline
for module in (panchroma, panchroma.offline):
    assert module.__file__.startswith(sys.argv[1]), module.__file__
shot = panchroma.simulate("builtin:96x72", sigma=0.01)
shot.save("shot.dng")
assert panchroma.open("shot.dng").shape == (72, 96)
panchroma.to_srgb(shot.truth).save("truth.png")
from panchroma.tools.cli import main
main(["preview", "shot.dng", "-o", "."])
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the wheel installs."""
    reason = "building the wheel needs setuptools 77 or newer: pip install 'setuptools>=77'"
    pytest.importorskip("setuptools", minversion="77", reason=reason)
    sources, folder = tmp_path_factory.mktemp("sources"), tmp_path_factory.mktemp("installed")
    for package in PACKAGES:  # a copy: setuptools leaves its work beside the sources
        shutil.copytree(
            ROOT / package,
            sources / package,
            ignore=shutil.ignore_patterns("__pycache__"),
            symlinks=True,
        )
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, sources)
    run_python(_BUILD, folder, folder=sources)
    (wheel,) = folder.glob("*.whl")
    with ZipFile(wheel) as archive:
        archive.extractall(folder)
    wheel.unlink()
    return folder


def test_every_file_that_the_program_needs_is_in_the_wheel(installed: Path) -> None:
    wanted = set()
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*")):
        place = path.relative_to(ROOT)
        if place.is_relative_to(_FACADE):
            place = place.relative_to(_FACADE)
        elif place.is_relative_to(_FACADE.parent):  # the notebook, and what it writes
            continue
        place = "panchroma" / place
        if path.is_file() and path.suffix not in _READ and "__pycache__" not in place.parts:
            wanted.add(place)
    found = {
        path.relative_to(installed)
        for path in installed.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert {path for path in found if not path.parts[0].endswith(".dist-info")} == wanted
    assert {path.parts[0] for path in found if not path.parts[0].endswith(".dist-info")} == {
        "panchroma"
    }
    assert {path.parent.name for path in found if path.name == "py.typed"} == {
        *PACKAGES,
        "panchroma",
    }


_ADVICE = """
import sys
sys.path.insert(0, sys.argv[1])
from panchroma.tools.io.versions import install_command
print(install_command(), install_command(""), install_command("all,cluster"), sep="\\n")
"""
_WHEEL = "file:///home/me/panchroma-0.1.0-py3-none-any.whl"


@pytest.mark.parametrize(
    ("origin", "source"),
    [
        (None, ""),  # an index
        ({"url": _WHEEL, "archive_info": {}}, f" @ {_WHEEL}"),
        ({"url": "file:///home/me/clone", "dir_info": {}}, " @ file:///home/me/clone"),
        (
            {"url": "https://example.org/p.git", "vcs_info": {"vcs": "git", "commit_id": "1"}},
            " @ git+https://example.org/p.git",
        ),
    ],
)
def test_advice_installs_from_where_this_one_came(
    origin: dict[str, object] | None, source: str, installed: Path, tmp_path: Path
) -> None:
    (record,) = installed.glob("*.dist-info")
    (record / "direct_url.json").unlink(missing_ok=True)
    if origin:
        (record / "direct_url.json").write_text(json.dumps(origin))
    lines = run_python(_ADVICE, installed, folder=tmp_path).splitlines()
    names = [f"panchroma{extra}{source}" for extra in ("[all]", "", "[all,cluster]")]
    assert lines == [f"pip install {quote(name)}" for name in names]


def test_advice_in_a_clone_names_its_folder() -> None:
    assert install_command("tools") == f"pip install -e '{ROOT}[tools]'"


def test_the_wheel_works_outside_the_clone(installed: Path, tmp_path: Path) -> None:
    run_python(_USE, installed, folder=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"shot.dng", "shot.jpg", "truth.png"}
