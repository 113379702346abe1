"""The commands of a camera, run where every package is hidden that the base dependencies do not
bring.
"""

import subprocess
from pathlib import Path

from tests.device.packer import pack, random_codes
from tests.python import base_modules, on_camera


def camera(line: str, stdin: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    script = "from panchroma.tools.cli import main; main()"
    return on_camera(script, *line.split(), ours=("shared", "device", "tools"), stdin=stdin)


def test_the_walk_finds_the_base_and_nothing_else() -> None:
    modules = base_modules()
    assert {"numpy", "onnxruntime", "tifffile", "imagecodecs"} <= modules
    assert not modules & {"onnx", "scipy", "rich", "PIL", "rawpy", "pytest", "numba", "offline"}


def test_capture_and_preview_need_the_base_alone_and_a_hidden_package_is_missed(
    tmp_path: Path,
) -> None:
    options = f"-o {tmp_path} --frames 1 --size 32x26 --pixel-format raw10"
    done = camera(f"capture - {options}", pack(random_codes((26, 32), 10), "raw10"))
    assert done.returncode == 0, done.stderr
    (shot,) = tmp_path.glob("*.dng")
    done = camera(f"preview {shot} -o {tmp_path} --scale 3")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / f"{shot.stem}.jpg").read_bytes().startswith(b"\xff\xd8")
    done = camera(f"render {shot} -o {tmp_path}")
    assert b"is not installed" in done.stderr


def test_a_notebook_needs_the_base_alone_but_to_render() -> None:
    script = """
import panchroma
shot = panchroma.simulate("flat:96x72", sigma=0.01)
print(panchroma.preview(shot), panchroma.to_srgb(shot.truth), len(shot._repr_png_()) > 0)
try:
    panchroma.render(shot)
except ModuleNotFoundError as error:
    print(error)
"""
    notebook = ("offline", "pictures", "quality", "shots", "simulation")
    done = on_camera(script, ours=("shared", "device", "tools", *notebook))
    assert done.returncode == 0, done.stderr
    assert b"<Image 96 x 72, 8-bit sRGB> <Image 96 x 72, 8-bit sRGB> True" in done.stdout
    assert b"is not installed; install Panchroma with all that belongs to it" in done.stdout
