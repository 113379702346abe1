"""The door: what may come in, what is refused and how that is said.

Drawn scenes: any size, repeatable, with the colours and charts that they say.
"""

import json
import os
import pickle
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from panchroma.shared.colorimetry import D50
from panchroma.shared.errors import InputError
from panchroma.tools.io.colour import xyz_to_lab
from panchroma.tools.io.limited import Facts, _received, run_limited
from panchroma.tools.io.scene import Scene, check_size
from panchroma.tools.simulation.drawn.builtin import ASPECT, CHARTS, GAP, HEIGHT, builtin_scene
from panchroma.tools.simulation.drawn.charts import COLOR_CHECKER_LAB
from panchroma.tools.simulation.load import load_scene, set_aside
from tests.data import DATA
from tests.tools.io.files import (
    CFA,
    LINEAR_RAW,
    LONG,
    RATIONAL,
    SHORT,
    noise,
    replace_segment,
    save,
    write_dng,
)

# --- load -----------------------------------------------------------------------------------------

PHOTOGRAPHS = sorted(
    path for folder in ("chart", "kodak", "linear", "raw") for path in (DATA / folder).glob("*")
)


@pytest.mark.skipif(
    not PHOTOGRAPHS,
    reason=f"photographs: none is in {DATA}: tests/README.md says where they are from",
)
@pytest.mark.parametrize("path", PHOTOGRAPHS, ids=lambda path: path.name)
def test_every_test_photograph_loads(path: Path) -> None:
    scene = load_scene(str(path))
    assert scene.name == path.stem
    assert scene.rgb.dtype == np.float32
    assert max(scene.neutral) == 1
    assert 0.4 < scene.rgb.max() < 1.01 / min(scene.neutral)  # where a file is clipped it is white
    assert scene.rgb.mean() > 0.01
    with pytest.raises(ValueError, match="read-only"):
        scene.rgb[0, 0, 0] = 1
    if scene.camera_to_xyz is not None:  # white stays white
        np.testing.assert_allclose(np.array(scene.camera_to_xyz) @ scene.neutral, D50, atol=1e-9)


def test_a_scene_is_checked_when_made() -> None:
    good = np.full((2, 3, 3), 0.5, np.float32)
    assert Scene(good, "a").shape == (2, 3)
    for bad in (good[..., 0], good[..., :2], good[:0], np.zeros((2, 2, 4), np.float32)):
        with pytest.raises(InputError, match="rows, columns, 3"):
            Scene(bad, "a")
    good[1, 1, 1] = -0.0003  # rounding
    assert Scene(good, "a").rgb.min() == 0
    assert good.min() < 0  # the caller's array is left alone
    for value, message in ((np.nan, "1 of 18 values are not finite"), (-0.01, "is not negative")):
        good[1, 1, 1] = value
        with pytest.raises(InputError, match=message):
            Scene(good, "a")


def test_sizes_are_bounded_before_decoding() -> None:
    check_size(11648, 8736, 6, 300 * 2**20)
    check_size(4000, 3000, 8, 6000)  # even light compresses well, and is a picture
    with pytest.raises(InputError, match=r"fill the memory.*save it without compression"):
        check_size(4000, 3300, 8, 6000)


def test_a_picture_under_another_name_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "photo.dng"
    Image.new("RGB", (40, 30)).save(path, "JPEG")
    with pytest.raises(InputError, match=r"is a JPEG picture.*photo\.jpg"):
        load_scene(str(path))
    path.rename(tmp_path / "photo.JPG")
    assert load_scene(str(tmp_path / "photo.JPG")).shape == (30, 40)


@pytest.mark.parametrize("beside", ["above", "fields"])
@pytest.mark.parametrize("suffix", [".dng", ".tif"])
def test_our_shots_are_refused_with_their_command(tmp_path: Path, beside: str, suffix: str) -> None:
    """Their private data lie beside the preview, or beside the samples."""
    path = tmp_path / f"shot{suffix}"
    directories: dict[str, Any] = {"above": {}, beside: {50740: (7, b"Panchroma\0{}")}}
    write_dng(path, noise(96, 96), **directories)
    with pytest.raises(InputError, match=r"this is a shot.*render it"):
        load_scene(str(path))


# --- files that are no scenes --------------------------------------------------------------------

Write = Callable[[Path], object]
X_TRANS = "GBGGRGRGRBGBGBGGRGGRGGBGBGBRGRGRGGBG"
LOSSY = {"compression": "jpeg", "compressionargs": {"level": 90}}


def written(samples: Any, **options: Any) -> Write:
    """A file by `save`."""
    return partial(save, light=samples, **options)


def dng(samples: Any, order: str = "RGGB", kind: int = CFA, **fields: Any) -> Write:
    """A DNG. fields: "t" and a tag -> type and values; other names are options of `write_dng`."""
    tags = {int(name[1:]): value for name, value in fields.items() if name[1:].isdigit()}
    others = {name: value for name, value in fields.items() if not name[1:].isdigit()}
    return lambda path: write_dng(path, samples, order, kind, tags, **others)


def levels(black: int, white: int) -> dict[str, Any]:
    return {"t50714": (SHORT, [black]), "t50717": (SHORT, [white])}


linear = partial(dng, noise(40, 52, 3), "", LINEAR_RAW)
BYTES = noise(40, 52, 3, dtype=np.uint8)
SEPARATE: Any = {"planarconfig": "separate"}
LARGE_TILES: Any = {"tile": (2064, 2064), "compression": "zlib"}
BROKEN_SHOT = b"II*\0\xf0\xff\xff\x7f" + b"Panchroma\0" * 20


def inflating(path: Path) -> None:
    """A small linear DNG whose only strip inflates to 50 MB of zeros."""
    linear(compression="deflate", rowsperstrip=40)(path)
    replace_segment(path, zlib.compress(bytes(50_000_000), 9))


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        ("four.dng", dng(noise(60, 80, 4), "", LINEAR_RAW), "several samples per pixel"),
        ("monochrome.dng", dng(noise(60, 80), "", LINEAR_RAW), "monochrome"),
        ("x-trans.dng", dng(noise(60, 84), X_TRANS), "in 6 x 6 pixels"),
        ("no-blue.dng", dng(noise(60, 80), "RGGG"), "nor a camera RAW that LibRaw knows"),
        ("levels.dng", dng(noise(60, 80), **levels(3000, 2000)), "black level"),
        ("linear.dng", linear(**levels(500, 400)), "black level 500 is not below white level 400"),
        ("infinite.dng", linear(t50714=(RATIONAL, (1, 0))), "black level inf is not below"),
        ("area.dng", linear(t50829=(LONG, (0, 0, 400, 52))), "the active area"),
        ("five.dng", linear(t50714=(SHORT, (1, 2, 3, 4, 5))), "5 black levels for 1 x 1 pixels"),
        ("inflating.dng", inflating, "hold more than they say"),
        ("lossy.dng", dng(BYTES, "", LINEAR_RAW, **LOSSY), "lossless JPEG"),
        ("jxl.dng", linear(compression="jpegxl"), "JPEGXL.* export it without JPEG XL"),
        ("proraw.dng", linear(compression=52546), "JPEGXL_DNG.* export it without JPEG XL"),
        ("double.dng", dng(noise(40, 52, 3, dtype=np.float64), "", LINEAR_RAW), "64 bits"),
        ("planes.dng", dng(noise(3, 40, 52), "", LINEAR_RAW, **SEPARATE), "separate planes"),
        ("shot.dng", lambda path: path.write_bytes(BROKEN_SHOT), "this is a shot"),
        (
            "tile.tif",
            partial(tifffile.imwrite, data=np.zeros((64, 64), np.uint8), **LARGE_TILES),
            "tiles of the TIFF hold 4260096 pixels, the picture 4096",
        ),
        ("cmyk.jpg", lambda path: Image.new("CMYK", (20, 20)).save(path), "CMYK"),
        ("z.exr", written(np.ones((5, 7, 1), np.float32), channels="Z"), "the channels Z"),
        ("five.npy", written(np.zeros((4, 4, 5))), "has 5 channels"),
        ("line.npy", written(np.zeros(7)), r"of shape \(7,\)"),
        ("signed.npy", written(np.zeros((4, 4, 3), "i2")), "is int16"),
        ("objects.npy", written(np.array([[{}]])), "cannot be decoded"),
        ("empty.npy", written(np.zeros((0, 4, 3))), "empty"),
    ],
)
def test_what_is_no_scene_is_refused_with_the_reason(
    tmp_path: Path, name: str, write: Write, words: str
) -> None:
    write(tmp_path / name)
    with pytest.raises(InputError, match=words):
        load_scene(str(tmp_path / name))


# --- a call in a process with limits -------------------------------------------------------------


def _answer(path: str, what: str) -> tuple[np.ndarray[Any, Any], Facts]:
    match what:
        case "refuse":
            raise InputError("is odd")
        case "spin":
            while True:
                pass
        case "swell":
            return np.ones((1 << 15, 1 << 15), np.uint8), {}
        case "crash":
            os.abort()
        case "forge":  # as code in a file that takes a library over might
            for number in range(3, 12):
                with suppress(OSError):
                    os.write(number, pickle.dumps(Path("harmless")) + b"\n")
    print("a library prints")
    return np.arange(6, dtype=np.uint16).reshape(2, 3), {"what": what, "name": Path(path).name}


@pytest.mark.parametrize(
    ("what", "message"),
    [
        *(("refuse", "is odd"), ("spin", "0.25 s"), ("swell", "192 MB")),
        *((what, "ends the process") for what in ("crash", "forge")),
    ],
)
def test_what_exceeds_its_limits_is_refused(tmp_path: Path, what: str, message: str) -> None:
    (tmp_path / "a").write_bytes(b"1")
    with pytest.raises(InputError, match=message):
        run_limited(tmp_path / "a", (), _answer, str(tmp_path / "a"), what)


def header(**changes: Any) -> bytes:
    """The first line of an answer of six samples."""
    facts = {"refused": "", "trace": "", "dtype": "uint8", "shape": [2, 3], "facts": {}}
    return json.dumps(facts | changes).encode()


@pytest.mark.parametrize(
    "answer",
    [
        *(b"", pickle.dumps((True, np.zeros(3))), b"[" * 100_000, b"[]", b"null"),
        *(header(dtype=dtype) for dtype in ("object", "float64")),
        *(header(shape=shape) for shape in ([6], [-2, -3], [2.0, 3], [2, 4], [1 << 20, 1 << 20])),
        *(header(facts=facts) for facts in (7, {"long": "x" * (1 << 20)})),
    ],
)
def test_an_answer_that_is_no_picture_is_refused(answer: bytes) -> None:
    refused, _, samples, facts = _received(BytesIO(header() + b"\n" + bytes(range(6))), 6)
    assert (refused, samples.tolist(), facts) == ("", [[0, 1, 2], [3, 4, 5]], {})
    with pytest.raises((ValueError, TypeError, LookupError, RecursionError)):
        _received(BytesIO(answer + b"\n" + bytes(6)), 1 << 20)


# --- folders -------------------------------------------------------------------------------------


def test_of_pictures_beside_a_camera_raw_the_raw_is_the_scene(tmp_path: Path) -> None:
    picture = noise(24, 32, 3, dtype=np.uint8)
    for name in ("DSC_1.JPG", "dsc_1.png", "DSC_1_edited.tif", "alone.jpg", "shot.png"):
        save(tmp_path / name.lower(), picture).rename(tmp_path / name)
    write_dng(tmp_path / "DSC_1.NEF", noise(60, 80))
    (tmp_path / "a.truth.png").touch()
    write_dng(tmp_path / "shot.dng", noise(60, 80), fields={50740: (7, b"Panchroma\0{}")})
    (tmp_path / "damaged.cr2").touch()
    (tmp_path / "damaged.jpg").touch()
    aside = set_aside(sorted(map(str, tmp_path.iterdir())))
    expected = dict.fromkeys(("DSC_1.JPG", "dsc_1.png", "damaged.jpg"), "beside a camera RAW")
    expected |= {"a.truth.png": "(the truth of a shot)", "shot.dng": "(a shot of Panchroma, no"}
    assert {Path(path).name for path in aside} == expected.keys()
    assert all(why.startswith(expected[Path(path).name]) for path, why in aside.items())


# --- drawn ----------------------------------------------------------------------------------------

# yellow and cyan: less blue, and less red, than sRGB or the scene's darkest value
BROUGHT_IN = [15, 17]


@pytest.mark.parametrize(
    ("width", "height"),
    [(1, 1), (2, 1), (1, 3), (7, 5), (64, 48), (143, 96), (144, 96), (61, 300), (300, 61)],
)
def test_any_size_works_and_repeats(width: int, height: int) -> None:
    first = builtin_scene(width, height)
    second = load_scene(first.name.replace("-", ":"))
    assert first.shape == (height, width)
    assert np.array_equal(first.rgb, second.rgb)
    assert np.float32(0.01) <= first.rgb.min() <= first.rgb.max() <= np.float32(0.95)


def test_patches_are_the_published_ones() -> None:
    """Read from the picture where the layout puts them, through the scene's own matrix, into CIE
    L*a*b* again.
    """
    scene = builtin_scene(600, 400)
    size = round(HEIGHT * min(600 / ASPECT, 400))
    gap = (600 - sum(round(size * aspect) for aspect in CHARTS.values())) / (len(CHARTS) + 1)
    top, left = 400 - size - round(GAP * 400), round(gap)
    for index, expected in enumerate(COLOR_CHECKER_LAB):
        row, column = (int((place + 0.5) * size / 4) for place in divmod(index, 6))
        patch = scene.rgb[top + row - 3 : top + row + 4, left + column - 3 : left + column + 4]
        assert np.ptp(patch, axis=(0, 1)).max() < 1e-6
        lab = xyz_to_lab(np.array(scene.camera_to_xyz) @ patch[0, 0])
        if index not in BROUGHT_IN:
            assert lab == pytest.approx(expected, abs=0.2)


@pytest.mark.parametrize("size", ["", "100", "0x5", "5x0", "-1x4", "1x1x1", "99999x99999"])
def test_bad_sizes_are_refused(size: str) -> None:
    with pytest.raises(InputError, match=r"builtin:1200x800|empty|raises it"):
        load_scene(f"builtin:{size}")
