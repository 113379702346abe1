"""Source distribution and wheel: every module and every file that the program reads is in them, and
they work where there is no clone.
"""

import json
import os
import re
import shutil
import sys
import tarfile
from pathlib import Path
from shlex import quote
from zipfile import ZipFile

import numpy as np
import pytest

from tests.data import ROOT, copy_clone
from tests.python import finished, run_python

PACKAGES = ("shared", "device", "offline", "tools")
_FACADE = Path("tools/notebook/panchroma")
# For clones, and for people who read the sources: training, texts and their pictures, the site.
_LEFT_OUT = "panchroma/tools/training", "panchroma/tools/notebook", "panchroma/tools/pages"
_READ = {".md", ".png", ".jpg"}
_CARD = {Path("panchroma/offline/models", name) for name in ("README.md", "loss-k6.png")}
_BUILD = """
import sys
sys.path.insert(0, "tools/notebook")
import build_with_links
getattr(build_with_links, sys.argv[1])(sys.argv[2])
"""
_LINK = re.compile(r"\]\(([^)#\s]+)")


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The unpacked source distribution of a copy of the clone."""
    reason = "building needs setuptools 77 or newer: pip install 'setuptools>=77'"
    pytest.importorskip("setuptools", minversion="77", reason=reason)
    clone, folder = tmp_path_factory.mktemp("clone"), tmp_path_factory.mktemp("sources")
    copy_clone(clone)
    run_python(_BUILD, "build_sdist", folder, folder=clone)
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    return folder / archive.name.removesuffix(".tar.gz")


@pytest.fixture(scope="module")
def wheel(sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that the source distribution makes."""
    folder = tmp_path_factory.mktemp("wheel")
    run_python(_BUILD, "build_wheel", folder, folder=sources)
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the wheel installs."""
    folder = tmp_path_factory.mktemp("installed")
    with ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def test_every_link_of_a_page_leads_to_a_file_of_the_source_distribution(sources: Path) -> None:
    pages = list(sources.rglob("*.md"))
    links = [(page, link) for page in pages for link in _LINK.findall(page.read_text("utf-8"))]
    dead = [
        (str(page.relative_to(sources)), link)
        for page, link in links
        if not link.startswith(("http://", "https://")) and not (page.parent / link).exists()
    ]
    assert not dead
    assert len(links) > 60
    assert not list(sources.rglob("test_*.py"))


def test_the_description_of_the_package_links_to_no_file(sources: Path) -> None:
    headers, _, description = (sources / "PKG-INFO").read_text("utf-8").partition("\n\n")
    assert "# Panchroma" in description
    assert not [link for link in _LINK.findall(description) if not link.startswith("https://")]
    assert "License-Expression: MIT AND CC-BY-SA-4.0" in headers


def test_every_file_that_the_program_needs_is_in_the_wheel(wheel: Path) -> None:
    wanted = {*_CARD}
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*")):
        base = ROOT / _FACADE if path.is_relative_to(ROOT / _FACADE) else ROOT
        place = "panchroma" / path.relative_to(base)
        if path.is_file() and path.suffix not in _READ and "__pycache__" not in place.parts:
            wanted.add(place)
    wanted = {path for path in wanted if not str(path).startswith(_LEFT_OUT)}
    with ZipFile(wheel) as archive:
        found = {Path(name) for name in archive.namelist()}
    assert {path for path in found if not path.parts[0].endswith(".dist-info")} == wanted
    typed = {path.parent.name for path in found if path.name == "py.typed"}
    assert typed == {*PACKAGES, "panchroma"}
    licences = {path.name for path in found if "licenses" in path.parts}
    assert licences == {"LICENSE", "README.md"}


_ADVICE = """
import sys
sys.path.insert(0, sys.argv[1])
from panchroma.tools.io.versions import install_command
print(install_command(), install_command(""), install_command("all,rivals"), sep="\\n")
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
    names = [f"panchroma{extra}{source}" for extra in ("[all]", "", "[all,rivals]")]
    assert lines == [f"pip install {quote(name)}" for name in names]


def test_the_wheel_renders_in_an_environment_of_its_own(wheel: Path, tmp_path: Path) -> None:
    environment, folder = tmp_path / "environment", tmp_path / "elsewhere"
    folder.mkdir()
    clean = {name: text for name, text in os.environ.items() if name != "PYTHONPATH"}

    def output(*line: str | Path) -> str:
        done = finished(*line, folder=folder, env=clean)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    output(sys.executable, "-m", "venv", environment)
    python, program = environment / "bin/python", environment / "bin/panchroma"
    output(python, "-m", "pip", "install", "-q", "--no-deps", "--no-index", wheel)
    own = Path(output(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"))
    # The packages that it needs are those of this environment, without its installation of ours.
    (own / "needed.pth").write_text(str(Path(np.__file__).parents[1]))
    output(program, *["simulate", "builtin:96x72", "--sigma", "0.01", "-o", "shots"])
    output(program, *["preview", "shots", "-o", "."])
    output(program, *["render", "shots", "-o", "pictures", "--preset", "paper"])
    for made in ("shots/builtin-96x72.dng", "builtin-96x72.jpg", "pictures/builtin-96x72.tif"):
        assert (folder / made).stat().st_size > 1000
    where = output(python, "-c", "import panchroma.offline as p; print(p.__file__)")
    assert Path(where).is_relative_to(own)


@pytest.mark.parametrize("found", ["a file", "nothing"])
def test_missing_links_are_made_and_files_in_their_way_refused(tmp_path: Path, found: str) -> None:
    facade = tmp_path / _FACADE
    facade.mkdir(parents=True)
    shutil.copy(ROOT / "tools/notebook/build_with_links.py", facade.parent)
    for name in PACKAGES:
        (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / name / "__init__.py").touch()
        if found == "a file":  # Git without symbolic links writes where they lead to
            (facade / name).write_text(f"../../../{name}")
    script = "import sys; sys.path.insert(0, 'tools/notebook'); import build_with_links"
    done = finished(sys.executable, "-c", script, folder=tmp_path)
    if found == "nothing":
        assert done.returncode == 0
        assert all((facade / name / "__init__.py").is_file() for name in PACKAGES)
    else:
        assert done.returncode == 1
        assert "without symbolic links" in done.stderr
        assert "Traceback" not in done.stderr
