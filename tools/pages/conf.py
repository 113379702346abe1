"""The site: READMEs are its prose, docstrings its API, scripts its examples.

Sphinx, because sphinx-gallery runs examples and keeps their pictures, numpydoc reads our
docstrings, and docutils makes MathML of equations: no script, and no file of another site.

    pip install -e '.[docs]' && python -m sphinx -W -c tools/pages . build/pages
"""

import re
import shutil
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

import panchroma
from panchroma.offline import burst, compile_kernel, kernels_to_compile

project, author = "Panchroma", "the Panchroma developers"
version = release = panchroma.__version__
extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
]
root_doc, pygments_style = "README", "friendly"
include_patterns = [
    "*.md",
    "*/**.md",
    "tools/pages/*.rst",
    "tools/pages/api/*.rst",
    "build/*/index.rst",
    "build/*/plot_*.rst",
]
exclude_patterns = [
    ".*",
    "build/method/index.rst",
    "build/pages",
    "tests/[a-z]*",
    "tools/notebook",
    "shared/data",
]
html_theme, html_title, html_show_copyright = "furo", "Panchroma", False
html_static_path, html_css_files = ["static"], ["site.css"]
html_math_renderer = "mathml"
myst_enable_extensions, myst_heading_anchors = ["dollarmath"], 4
numpydoc_show_class_members, autodoc_typehints = False, "none"
autodoc_preserve_defaults, default_role, smartquotes = True, "py:obj", False
sphinx_gallery_conf: dict[str, Any] = {
    "examples_dirs": ["tools/pages/gallery", "tools/pages/method"],
    "gallery_dirs": ["build/gallery", "build/method"],
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,
}

_LINK = re.compile(r"(?<=\]\()(?!https?:|#)([^)#\s]+)")


def _complete(app: Sphinx, page: str, text: list[str]) -> None:
    """Give the front page the contents and the page on parity its sections of offline/README.md;
    a link to a folder leads to its first module, one to an example to the page that it makes.
    """
    source = Path(app.srcdir)
    if page == root_doc:
        text[0] += (source / "tools/pages/contents.txt").read_text("utf-8")
    if page == "tools/pages/parity":
        readme = (source / "offline/README.md").read_text("utf-8")
        kept = re.findall(r"^## (?:The paper|Errata).*?(?=^## |\Z)", readme, re.M | re.S)
        text[0] += _LINK.sub(r"../../offline/\1", "".join(kept))
    folder = (source / page).parent

    def to_file(link: re.Match[str]) -> str:
        target = folder / link[1]
        if "/pages/gallery/" in link[1]:
            return link[1].replace("tools/pages", "build").replace(".py", ".rst")
        modules = target.glob("*.py") if target.is_dir() else ()
        return link[1] + min((path.name for path in modules), default="")

    text[0] = _LINK.sub(to_file, text[0])


def _write_math(writer: Any, node: nodes.Element) -> None:
    block = isinstance(node, nodes.math_block)
    markup = tex2mathml(node.astext(), as_block=block)
    writer.body.append(f'<div class="math">{markup}</div>' if block else markup)
    raise nodes.SkipNode


def _finish(app: Sphinx, error: Exception | None) -> None:
    """Begin the site with the front page."""
    if error is None and app.builder.name == "html":
        shutil.copy(Path(app.outdir) / "README.html", Path(app.outdir) / "index.html")


def setup(app: Sphinx) -> None:
    """Register what Sphinx has no option for; compile what examples would tell of."""
    assert burst  # which has kernels, too
    for kernel in kernels_to_compile():
        compile_kernel(kernel)
    app.add_html_math_renderer("mathml", (_write_math, None), (_write_math, None))
    app.connect("source-read", _complete)
    app.connect("build-finished", _finish)
