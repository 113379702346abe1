"""JPEG XL, read back by another program: the samples, and in which colours they are."""

import json
import shutil
import subprocess
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
from numpy.typing import NDArray

from shared.arrays import FloatArray
from shared.errors import InputError
from tests.exiftool import exiftool
from tests.tools.pictures.examples import CALIBRATION, encoded, scene, shown
from tests.tools.pictures.examples import KINDS as ALL_KINDS
from tools.pictures.kind import PictureKind
from tools.pictures.samples import quantise

KINDS = [kind for kind in ALL_KINDS if kind.format == "jxl"]
LITTLE = 0.012
"""Mean difference at quality 90, relative to white; in other colours than the file says it is 0.05 and more."""


def samples(rgb: FloatArray, kind: PictureKind) -> NDArray[np.generic]:
    pixels = shown(rgb, kind.space, 6)
    return pixels if kind.bits == 32 else quantise(pixels, kind.bits)


def smooth() -> FloatArray:
    """Saturated colours of all hues, beyond those of sRGB too, without noise."""
    down, across = np.mgrid[0:1:80j, 0:1:120j]
    rgb = np.stack([across, 1 - across, down], axis=-1) * np.array(CALIBRATION.neutral)
    return np.asarray(rgb, np.float32)


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_older_decoders_read_it(kind: PictureKind, tmp_path: Path) -> None:
    """Those of libjxl 0.7, which Linux distributions have, stumbled over negative values in floating point."""
    if shutil.which("djxl") is None:
        pytest.skip("djxl is not installed")
    rgb = 4 * scene((300, 400))
    assert samples(rgb, PictureKind("jxl", 32, "linear-srgb")).min() < 0
    written, read = tmp_path / "picture.jxl", tmp_path / ("picture.pfm" if kind.bits == 32 else "picture.png")
    written.write_bytes(encoded(rgb, kind).getvalue())
    done = subprocess.run(["djxl", written, read], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    expected, data = samples(rgb, kind), read.read_bytes()
    if kind.bits < 32:
        assert np.array_equal(imagecodecs.png_decode(data), expected)
    else:
        order = "<" if data.split(b"\n", 3)[2].startswith(b"-") else ">"
        assert np.array_equal(np.frombuffer(data[-expected.nbytes :], f"{order}f4").reshape(expected.shape)[::-1], expected)


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_with_loss_colours_are_those_that_the_file_names(kind: PictureKind) -> None:
    """The reader makes them from JPEG XL's own, as the codec has labelled them."""
    sizes = []
    for quality in (20, 90):
        data = encoded(smooth(), PictureKind(kind.format, kind.bits, kind.space, quality)).getvalue()
        read, expected = imagecodecs.jpegxl_decode(data), samples(smooth(), kind)
        sizes.append(len(data))
    assert read.dtype == expected.dtype
    white = 1 if kind.bits == 32 else 2**kind.bits - 1
    assert np.abs(read.astype(float) - expected).mean() < LITTLE * white
    assert sizes[0] < sizes[1]


def test_quality_100_is_without_loss() -> None:
    plain, best = (encoded(scene((30, 20)), PictureKind("jxl", 8, "srgb", quality)).getvalue() for quality in (None, 100))
    assert plain == best


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_size_and_level_are_seen(kind: PictureKind, tmp_path: Path) -> None:
    path = tmp_path / "picture.jxl"
    path.write_bytes(encoded(scene((5, 6)), kind).getvalue())
    (found,) = json.loads(exiftool("-j", "-n", "-ImageWidth", "-ImageHeight", "-FileType", "-warning", path))
    assert (found["ImageWidth"], found["ImageHeight"], found["FileType"]) == (5, 6, "JXL")
    assert "Warning" not in found


def test_without_the_codec_it_is_refused_before_anything_is_rendered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imagecodecs.JPEGXL, "available", False)
    with pytest.raises(InputError, match="imagecodecs has no JPEG XL; install that of PyPI"):
        PictureKind.of("jxl")
    assert PictureKind.of("uhdr")
