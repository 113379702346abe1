"""The commands of a camera, run where every package is hidden that the base dependencies do not bring."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

import pytest

from tests.data import ROOT
from tests.device.packer import pack, random_codes

OURS = {"shared", "device", "tools"}

RUN = """
import sys
allowed = set({allowed!r}) | set(sys.stdlib_module_names)
class Hide:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in allowed:
            raise ModuleNotFoundError(f"No module named {{name!r}}: a camera does not have it", name=name)
sys.meta_path.insert(0, Hide())
from tools.cli import main
main()
"""


def base_modules() -> set[str]:
    """The modules that an installation without extras has."""
    wanted = list(tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"])
    found: set[str] = set()
    while wanted:
        requirement = wanted.pop()
        name = re.split(r"[^\w.-]", requirement)[0].lower().replace("_", "-")
        if name in found or "extra ==" in requirement:
            continue
        try:
            wanted += requires(name) or []
        except PackageNotFoundError:  # needed on another system
            continue
        found.add(name)
    modules = packages_distributions()
    return {module for module, owners in modules.items() if {owner.lower().replace("_", "-") for owner in owners} & found}


def camera(*arguments: str, stdin: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    script = RUN.format(allowed=sorted(base_modules() | OURS))
    return subprocess.run(
        [sys.executable, "-c", script, *arguments], input=stdin, cwd=ROOT, capture_output=True, check=False, timeout=120
    )


def test_the_walk_finds_the_base_and_nothing_else() -> None:
    modules = base_modules()
    assert {"numpy", "onnxruntime", "tifffile", "imagecodecs"} <= modules
    assert not modules & {"onnx", "scipy", "rich", "PIL", "rawpy", "pytest", "numba", "offline"}


def test_a_hidden_package_is_missed() -> None:
    done = camera("render", "nothing.dng", "-o", ".", "-j", "1")  # threads are the renderer's
    assert b"No module named" in done.stderr + done.stdout


@pytest.mark.parametrize("source", ["builtin:96x64@20", "-"])
def test_capture_needs_the_base_alone(tmp_path: Path, source: str) -> None:
    layout = [] if source != "-" else ["--width", "32", "--height", "26", "--format", "raw10"]
    done = camera("capture", source, "-o", str(tmp_path), "--frames", "1", *layout, stdin=pack(random_codes((26, 32), 10), "raw10"))
    assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.glob("*.dng"))) == 1


def test_preview_needs_the_base_alone(tmp_path: Path) -> None:
    assert camera("capture", "builtin:96x64@20", "-o", str(tmp_path), "--frames", "1").returncode == 0
    (shot,) = tmp_path.glob("*.dng")
    done = camera("preview", str(shot), "-o", str(tmp_path), "--scale", "3")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / f"{shot.stem}.jpg").read_bytes().startswith(b"\xff\xd8")
