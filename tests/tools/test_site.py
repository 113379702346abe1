"""The site builds without a warning, its links lead somewhere, the API has every public name, and
its examples are short.
"""

import ast
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from tests.data import ROOT, copy_clone
from tests.python import finished
from tests.test_examples import PUBLIC
from tests.tools.test_pages import Outline

EXAMPLES = sorted((ROOT / "tools/pages/gallery").glob("*.py"))


def code_lines(path: Path) -> int:
    """Lines of code without blank ones, comments and the text at the top."""
    text = path.read_text("utf-8")
    head = ast.parse(text).body[0].end_lineno
    return sum(bool(line.strip()) and line[0] != "#" for line in text.splitlines()[head:])


def dead_links(site: Path) -> list[str]:
    """Return a line for each link within a site to a file or an anchor that is not there."""
    pages = {path: Outline(path.read_text("utf-8")) for path in site.rglob("*.html")}
    anchors, dead = {path: page.stated("id", "name") for path, page in pages.items()}, []
    for path, page in pages.items():
        for link in map(urlsplit, page.stated("href", "src")):
            target = (path.parent / unquote(link.path)).resolve() if link.path else path
            known = anchors.get(target, {unquote(link.fragment)})
            leads = target.exists() and unquote(link.fragment) in {"", *known}
            if not (link.scheme or leads):
                dead.append(f"{path.relative_to(site)}: {link.geturl()}")
    return dead


def test_there_are_ten_short_examples() -> None:
    assert len(EXAMPLES) == 10
    assert {path.stem: lines for path in EXAMPLES if (lines := code_lines(path)) >= 30} == {}


def test_planted_dead_links_are_found(tmp_path: Path) -> None:
    links = "a.html#b", "#b", "https://example.org", "b.png", "a.html#c", "#c", "c.html", "../d"
    (tmp_path / "b.png").touch()
    texts = ("<p id=b></p>", *(f"<a href={link}></a>" for link in links))
    (tmp_path / "a.html").write_text("".join(texts))
    assert {line.split()[1] for line in dead_links(tmp_path)} == {*links[4:]}


def test_the_site_builds_with_warnings_as_errors(tmp_path: Path) -> None:
    remedy = "the site: docs are not installed; pip install -e '.[docs]'"
    for package in ("sphinx", "myst_parser", "numpydoc", "sphinx_gallery", "furo"):
        pytest.importorskip(package, reason=remedy)
    copy_clone(tmp_path)
    line = [sys.executable, "-m", "sphinx", "-W", "-q", "-c", "tools/pages", ".", "build/pages"]
    done = finished(*line, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "build/pages/index.html").is_file()
    assert len(list((tmp_path / "build/gallery/images").glob("*_001.png"))) == len(EXAMPLES)
    site = tmp_path.resolve() / "build/pages"
    assert dead_links(site) == []
    api = (Outline(page.read_text("utf-8")) for page in (site / "tools/pages/api").glob("*.html"))
    documented = set[str]().union(*(page.stated("id", "name") for page in api))
    assert {f"{module.__name__}.{name}" for module, name in PUBLIC} <= documented
