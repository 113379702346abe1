"""Files of every format that are no scenes: each is refused, with the reason."""

import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from shared.errors import InputError
from tests.tools.scenes.files import CFA, LINEAR_RAW, LONG, RATIONAL, SHORT, save, write_dng
from tools.scenes.load import load_scene

Write = Callable[[Path], object]
X_TRANS = "GBGGRGRGRBGBGBGGRGGRGGBGBGBRGRGRGGBG"
LOSSY = {"compression": "jpeg", "compressionargs": {"level": 90}}


def noise(*shape: int, dtype: Any = np.uint16) -> np.ndarray[Any, Any]:
    return np.random.default_rng(0).integers(200, 4000, shape).astype(dtype)


def written(samples: Any, **options: Any) -> Write:
    """A file by `save`."""
    return partial(save, light=samples, **options)


def dng(samples: Any, order: str = "RGGB", kind: int = CFA, **fields: Any) -> Write:
    """A DNG. fields: "t" and a tag -> type and values; other names are options of `write_dng`."""
    tags = {int(name[1:]): value for name, value in fields.items() if name[1:].isdigit()}
    others = {name: value for name, value in fields.items() if not name[1:].isdigit()}
    return lambda path: write_dng(path, samples, order, kind, tags, **others)


linear = partial(dng, noise(40, 52, 3), "", LINEAR_RAW)


def inflating(path: Path) -> None:
    """A small linear DNG whose only strip inflates to 50 MB of zeros."""
    linear(compression="deflate", rowsperstrip=40)(path)
    with tifffile.TiffFile(path) as file:
        tags = file.pages.first.tags
        offset, count = tags[273].valueoffset, tags[279].valueoffset
    strip, data = zlib.compress(bytes(50_000_000), 9), bytearray(path.read_bytes())
    for place, value in ((offset, len(data)), (count, len(strip))):
        data[place : place + 4] = value.to_bytes(4, "little")
    path.write_bytes(bytes(data) + strip)


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        ("four.dng", dng(noise(60, 80, 4), "", LINEAR_RAW), "several samples per pixel"),
        ("monochrome.dng", dng(noise(60, 80), "", LINEAR_RAW), "monochrome"),
        ("x-trans.dng", dng(noise(60, 84), X_TRANS), "X-Trans"),
        ("no-blue.dng", dng(noise(60, 80), "RGGG"), "nor a camera RAW that LibRaw knows"),
        ("levels.dng", dng(noise(60, 80), t50714=(SHORT, [3000]), t50717=(SHORT, [2000])), "black level"),
        ("linear.dng", linear(t50714=(SHORT, [500]), t50717=(SHORT, [400])), "black level 500 is not below white level 400"),
        ("infinite.dng", linear(t50714=(RATIONAL, (1, 0))), "black level inf is not below"),
        ("area.dng", linear(t50829=(LONG, (0, 0, 400, 52))), "the active area"),
        ("five.dng", linear(t50714=(SHORT, (1, 2, 3, 4, 5))), "5 black levels for 1 x 1 pixels"),
        ("inflating.dng", inflating, "hold more than they say"),
        ("lossy.dng", dng(noise(40, 52, 3, dtype=np.uint8), "", LINEAR_RAW, **LOSSY), "lossless JPEG"),
        ("jxl.dng", linear(compression="jpegxl"), "JPEGXL"),
        ("double.dng", dng(noise(40, 52, 3, dtype=np.float64), "", LINEAR_RAW), "64 bits"),
        ("planes.dng", dng(noise(3, 40, 52), "", LINEAR_RAW, planarconfig="separate"), "separate planes"),
        ("shot.dng", lambda path: path.write_bytes(b"II*\0\xf0\xff\xff\x7f" + b"Panchroma\0" * 20), "this is a shot"),
        (
            "tile.tif",
            lambda path: tifffile.imwrite(path, np.zeros((64, 64), np.uint8), tile=(2064, 2064), compression="zlib"),
            "tiles of the TIFF hold 4260096 pixels, the picture 4096",
        ),
        ("cmyk.jpg", lambda path: Image.new("CMYK", (20, 20)).save(path), "CMYK"),
        ("z.exr", written(np.ones((5, 7, 1), np.float32), channels="Z"), "the channels Z"),
        ("five.npy", written(np.zeros((4, 4, 5))), "has 5 channels"),
        ("line.npy", written(np.zeros(7)), r"of shape \(7,\)"),
        ("signed.npy", written(np.zeros((4, 4, 3), "i2")), "is int16"),
        ("complex.npy", written(np.zeros((4, 4, 3), "c8")), "is complex64"),
        ("objects.npy", written(np.array([[{}]])), "cannot be decoded"),
        ("empty.npy", written(np.zeros((0, 4, 3))), "empty"),
    ],
)
def test_what_is_no_scene_is_refused_with_the_reason(tmp_path: Path, name: str, write: Write, words: str) -> None:
    write(tmp_path / name)
    with pytest.raises(InputError, match=words):
        load_scene(str(tmp_path / name))
