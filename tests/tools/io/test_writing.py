"""Writing pictures: the bytes do not depend on how a picture is divided into bands, and a file is
whole or absent.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageOps

from panchroma.shared.arrays import FloatArray
from panchroma.shared.errors import ConvergenceError
from panchroma.tools.io.development import CAMERA
from panchroma.tools.io.display import quantise, upright
from panchroma.tools.io.kind import PictureKind, write_picture
from tests.tools.io.examples import KINDS, development, encode_picture, scene


def cut(rgb: FloatArray, rows: int) -> Iterator[FloatArray]:
    return (rgb[top : top + rows].copy() for top in range(0, len(rgb), rows))


@pytest.mark.parametrize("kind", KINDS, ids=str)
@pytest.mark.parametrize(
    ("shape", "rows", "threads", "orientations", "stops"),
    [
        ((1, 1), 1, 1, [1, 8], 0),
        ((130, 33), 7, 1, [2, 5], 0),
        ((65, 129), 100, 3, range(1, 9), -3),  # darkened, so that what is burnt out shows
        ((700, 50), 90, 3, [6], 0),
    ],
)
def test_bands_of_any_height_by_any_number_of_threads_are_the_same_bytes(
    tmp_path: Path,
    kind: PictureKind,
    shape: tuple[int, int],
    rows: int,
    threads: int,
    orientations: Iterable[int],
    stops: float,
) -> None:
    rgb, exposure = scene(shape) * np.float32(1 - stops), 0.0 if kind.space == CAMERA else stops
    for orientation in orientations:
        changed = {"exposure": exposure, "restored": orientation % 2 == 0}
        how = development(kind, shape, orientation, **changed)
        path = tmp_path / str(orientation)
        write_picture(path, cut(rgb, rows), how, threads=threads)
        assert path.read_bytes() == encode_picture(rgb, how)
    assert len(list(tmp_path.iterdir())) == len(list(orientations))


def fails() -> Iterator[FloatArray]:
    yield scene((10, 20))
    raise ConvergenceError("no further")


@pytest.mark.parametrize("name", ["tif", "png"])
@pytest.mark.parametrize("orientation", [1, 6])
def test_nothing_is_left_of_a_failed_rendering(tmp_path: Path, name: str, orientation: int) -> None:
    how, path = development(PictureKind.of(name), (30, 20), orientation), tmp_path / "picture"
    path.write_bytes(b"old")
    for written in (path, tmp_path / "new"):
        with pytest.raises(ConvergenceError):
            write_picture(written, fails(), how, overwrite=True)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"old"


def test_quantising_rounds_and_clips() -> None:
    levels = (np.array([-255, 0, 0.4, 0.6, 255, 999]) / 255).astype(np.float32)
    assert quantise(levels, 8).tolist() == [0, 0, 0, 1, 255, 255]


@pytest.mark.parametrize("orientation", range(1, 9))
def test_upright_is_what_other_programs_show(orientation: int) -> None:
    samples = np.random.default_rng(0).integers(0, 256, (3, 5, 3), np.uint8)
    image = Image.fromarray(samples)
    image.getexif()[274] = orientation
    assert np.array_equal(upright(samples, orientation), np.asarray(ImageOps.exif_transpose(image)))
