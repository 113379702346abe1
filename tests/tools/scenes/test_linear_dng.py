"""Linear DNGs as scenes: those of `panchroma render`, and what other programs may write."""

import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from tifffile import TiffWriter

from shared.colorimetry import D50
from shared.errors import InputError
from tools.scenes.load import load_scene

SHAPE = (40, 52, 3)
NEUTRAL = (0.5, 1.0, 0.625)
LOSSLESS = {"lossless": True, "predictor": 1, "bitspersample": 16}
XYZ_TO_CAMERA = ((0.8, -0.2, -0.1), (-0.4, 1.2, 0.2), (-0.1, 0.2, 0.6))


def codes(dtype: Any = np.uint16, seed: int = 0) -> Any:
    values = np.random.default_rng(seed).integers(0, 60000, SHAPE)
    return values.astype(dtype) if np.dtype(dtype).kind == "u" else (values / 65536).astype(dtype)


def fraction(values: Any) -> list[int]:
    return [part for value in np.ravel(values) for part in (round(value * 10000), 10000)]


def save(path: Path, samples: Any, *, below: bool = True, fields: tuple[Any, ...] = (), **options: Any) -> Path:
    """A linear DNG, its samples in the first directory or below it; fields: of the samples' directory."""
    camera = [
        (50706, 1, 4, bytes([1, 4, 0, 0]), True),
        (50721, 10, 9, fraction(XYZ_TO_CAMERA), True),
        (50778, 3, 1, 21, True),
        (50728, 5, 3, fraction(NEUTRAL), True),
        (274, 3, 1, 6, True),
        (271, 2, None, "Contax", True),
    ]
    with TiffWriter(path) as file:
        if below:
            file.write(np.zeros((8, 8, 3), np.uint8), photometric="rgb", subfiletype=1, subifds=1, extratags=camera)
        tags = fields if below else (*camera, *fields)
        file.write(samples, photometric="linear_raw", subfiletype=0, extratags=tags, **options)
    return path


@pytest.mark.parametrize("below", [True, False])
@pytest.mark.parametrize(
    ("dtype", "options"),
    [
        (np.uint16, {}),
        (np.uint16, {"tile": (16, 32)}),
        (np.uint16, {"rowsperstrip": 7}),
        (np.uint16, {"compression": "deflate", "rowsperstrip": 16}),
        (np.uint16, {"compression": "deflate", "predictor": True, "tile": (32, 16)}),
        (np.uint16, {"compression": "jpeg", "compressionargs": LOSSLESS, "tile": (32, 16), "bitspersample": 16}),
        (np.float32, {}),
        (np.float32, {"compression": "deflate", "predictor": True, "tile": (16, 16)}),
        (np.float16, {"compression": "deflate", "predictor": True}),
    ],
)
def test_samples_of_every_lossless_kind(tmp_path: Path, dtype: Any, options: dict[str, Any], below: bool) -> None:
    samples = codes(dtype)
    scene = load_scene(str(save(tmp_path / "x.dng", samples, below=below, **options)))
    np.testing.assert_allclose(scene.rgb, samples.astype(np.float64) / (65535 if samples.dtype.kind == "u" else 1), atol=1e-6)
    assert scene.neutral == pytest.approx(NEUTRAL)
    assert not scene.neutral_estimated
    np.testing.assert_allclose(np.array(scene.camera_to_xyz) @ NEUTRAL, D50, atol=1e-4)
    assert (scene.metadata.orientation, scene.metadata.make) == (6, "Contax")


def test_levels_table_and_active_area(tmp_path: Path) -> None:
    samples = np.minimum(codes(), 38000)  # nothing is clipped
    black = np.array([[[100, 200, 300], [110, 210, 310]]])
    fields = (
        (50713, 3, 2, (1, 2), True),
        (50714, 5, 6, fraction(black), True),
        (50715, 10, 48, fraction(np.arange(48) / 4), True),
        (50717, 4, 3, (60000, 50000, 40000), True),
        (50829, 4, 4, (2, 3, 38, 51), True),
    )
    path = save(tmp_path / "x.dng", samples, fields=fields)
    levels = np.tile(black, (36, 24, 1)) + np.arange(48)[None, :, None] / 4
    expected = (samples[2:38, 3:51] - levels) / (np.array((60000, 50000, 40000)) - levels.max(axis=(0, 1)))
    np.testing.assert_allclose(load_scene(str(path)).rgb, expected.clip(0), atol=1e-5)
    table = np.linspace(0, 65535, 4096).astype(int)
    short = np.random.default_rng(0).integers(0, 4000, SHAPE).astype(np.uint16)
    path = save(tmp_path / "y.dng", short, fields=((50712, 3, 4096, table.tolist(), True), (50717, 3, 1, 65535, True)))
    np.testing.assert_allclose(load_scene(str(path)).rgb, table[short] / 65535, atol=1e-6)


def test_without_a_neutral_it_is_estimated_and_marked(tmp_path: Path) -> None:
    with TiffWriter(tmp_path / "x.dng") as file:
        tags = [(50706, 1, 4, bytes([1, 4, 0, 0]), True)]
        file.write((codes() * np.array(NEUTRAL)).astype(np.uint16), photometric="linear_raw", subfiletype=0, extratags=tags)
    scene = load_scene(str(tmp_path / "x.dng"))
    assert scene.neutral_estimated
    assert scene.neutral == pytest.approx(NEUTRAL, abs=0.05)
    assert "is estimated from the scene" in scene.notes[0]


def deflated(path: Path, size: int) -> Path:
    """A small linear DNG whose only strip inflates to `size` zeros."""
    save(path, codes(), compression="deflate", rowsperstrip=SHAPE[0])
    with tifffile.TiffFile(path) as file:
        below: Any = file.pages.first.pages
        tags = below[0].tags
        offset, count = tags[273].valueoffset, tags[279].valueoffset
    strip, data = zlib.compress(bytes(size), 9), bytearray(path.read_bytes())
    for place, value in ((offset, len(data)), (count, len(strip))):
        data[place : place + 4] = value.to_bytes(4, "little")
    path.write_bytes(bytes(data) + strip)
    return path


def test_a_strip_that_holds_more_than_it_says_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="hold more than they say"):
        load_scene(str(deflated(tmp_path / "x.dng", 50_000_000)))


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (((50714, 3, 1, 500, True), (50717, 3, 1, 400, True)), "black level 500 is not below white level 400"),
        (((50714, 5, 1, (1, 0), True),), "black level inf is not below"),
        (((50829, 4, 4, (0, 0, 400, 52), True),), "the active area"),
        (((50714, 3, 5, (1, 2, 3, 4, 5), True),), "5 black levels for 1 x 1 pixels"),
    ],
)
def test_impossible_levels_are_refused(tmp_path: Path, fields: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load_scene(str(save(tmp_path / "x.dng", codes(), fields=fields)))


@pytest.mark.parametrize(
    ("samples", "options", "words"),
    [
        (codes(np.uint8) % 200, {"compression": "jpeg", "compressionargs": {"level": 90}}, "lossless JPEG"),
        (codes(), {"compression": "jpegxl"}, "JPEGXL"),
        (codes(np.float64), {}, "64 bits"),
        (np.moveaxis(codes(), -1, 0), {"planarconfig": "separate"}, "separate planes"),
    ],
)
def test_lossy_and_odd_samples_are_refused(tmp_path: Path, samples: Any, options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        load_scene(str(save(tmp_path / "x.dng", samples, **options)))
