"""Writing pictures: the bytes do not depend on how a picture is divided into bands, and a file is whole or absent."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageOps

from shared.arrays import FloatArray
from shared.errors import ConvergenceError, InputError, OutputError
from tests.tools.io.examples import KINDS, development, encode_picture, scene
from tools.io.colour import decode_srgb, encode_srgb
from tools.io.development import CAMERA, write_picture
from tools.io.formats import FORMATS
from tools.io.kind import PictureKind
from tools.io.samples import quantise, regrouped, upright


def cut(rgb: FloatArray, rows: int) -> Iterator[FloatArray]:
    return (rgb[top : top + rows].copy() for top in range(0, len(rgb), rows))


@pytest.mark.parametrize("kind", KINDS, ids=str)
@pytest.mark.parametrize(
    ("shape", "rows", "threads", "orientations", "stops"),
    [
        ((1, 1), 1, 1, range(1, 9), 0),
        ((130, 33), 7, 1, range(1, 9), 0),
        ((65, 129), 100, 3, range(1, 9), -3),  # darkened, so that what is burnt out shows
        ((700, 50), 90, 3, [6], 0),
    ],
)
def test_bands_of_any_height_by_any_number_of_threads_are_the_same_bytes(
    tmp_path: Path, kind: PictureKind, shape: tuple[int, int], rows: int, threads: int, orientations: Iterable[int], stops: float
) -> None:
    for orientation in orientations:
        rgb, exposure = scene(shape) * np.float32(1 - stops), 0.0 if kind.space == CAMERA else stops
        how = development(kind, shape, orientation, exposure=exposure, restored=orientation % 2 == 0)
        path = tmp_path / str(orientation)
        write_picture(path, cut(rgb, rows), how, threads=threads)
        assert path.read_bytes() == encode_picture(rgb, how)
    assert len(list(tmp_path.iterdir())) == len(list(orientations))


def fails() -> Iterator[FloatArray]:
    yield scene((10, 20))
    raise ConvergenceError("no further")


@pytest.mark.parametrize("name", ["tif", "png"])
@pytest.mark.parametrize("orientation", [1, 6])
@pytest.mark.parametrize("overwrite", [False, True])
def test_nothing_is_left_of_a_rendering_that_fails(tmp_path: Path, name: str, orientation: int, overwrite: bool) -> None:
    path = tmp_path / "picture"
    if overwrite:
        path.write_bytes(b"old")
    with pytest.raises(ConvergenceError):
        write_picture(path, fails(), development(PictureKind.of(name), (30, 20), orientation), overwrite=overwrite)
    assert list(tmp_path.iterdir()) == ([path] if overwrite else [])
    assert not overwrite or path.read_bytes() == b"old"


def test_a_full_disk_is_named(tmp_path: Path, full_disk: Callable[[], None]) -> None:
    full_disk()
    with pytest.raises(OutputError, match=r"picture\.tif: the disk is full"):
        write_picture(tmp_path / "picture.tif", cut(scene((9, 9)), 4), development(PictureKind.of("tif"), (9, 9)))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", [PictureKind.of(name) for name in FORMATS], ids=str)
def test_no_format_overwrites_unasked_or_leaves_parts(kind: PictureKind, tmp_path: Path) -> None:
    path, rgb, how = tmp_path / f"picture{kind.suffix}", scene((4, 4)), development(kind, (4, 4))
    path.write_bytes(b"mine")
    with pytest.raises(OutputError, match="exists already"):
        write_picture(path, [rgb], how)
    assert path.read_bytes() == b"mine"
    write_picture(path, [rgb], how, overwrite=True)
    assert path.read_bytes() != b"mine"
    with pytest.raises(OutputError, match="does not exist; create it first"):
        write_picture(tmp_path / "no" / path.name, [rgb], how)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("heights", [[], [5], [64], [1, 63, 64, 65], [7] * 30, [200]])
def test_regrouped_rows_are_the_same_rows(heights: list[int]) -> None:
    rows = np.arange(sum(heights) * 3).reshape(-1, 1, 3)
    bands = np.split(rows, np.cumsum(heights)[:-1]) if heights else []
    found = list(regrouped(bands, 64))
    assert [len(band) for band in found] == [64] * (len(rows) // 64) + [len(rows) % 64] * (len(rows) % 64 > 0)
    if found:
        assert np.array_equal(np.concatenate(found), rows)


# --- codes ------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bits", [8, 16])
def test_every_code_survives_the_way_to_light_and_back(bits: int) -> None:
    codes = np.arange(1 << bits)
    encoded = (codes / codes[-1]).astype(np.float32)
    assert (quantise(encoded, bits) == codes).all()
    assert (quantise(encode_srgb(decode_srgb(encoded).astype(np.float32)), bits) == codes).all()


def test_quantising_rounds_and_clips() -> None:
    assert quantise(np.array([-1.0, 0.0, 0.4 / 255, 0.6 / 255, 1.0, 9.0], np.float32), 8).tolist() == [0, 0, 0, 1, 255, 255]


# --- orientation ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("orientation", range(1, 9))
def test_upright_is_what_other_programs_show(orientation: int) -> None:
    samples = np.random.default_rng(0).integers(0, 256, (3, 5, 3), np.uint8)
    image = Image.fromarray(samples)
    image.getexif()[274] = orientation
    assert np.array_equal(upright(samples, orientation), np.asarray(ImageOps.exif_transpose(image)))


@pytest.mark.parametrize("orientation", [0, 9])
def test_an_orientation_that_does_not_exist_is_refused(orientation: int) -> None:
    with pytest.raises(InputError, match="1 to 8"):
        upright(np.zeros((2, 2, 3)), orientation)
