"""Pictures written in bands are the same files, to the byte."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shared import CaptureMetadata, SensorCalibration
from shared.arrays import FloatArray
from shared.errors import ConvergenceError, InputError, OutputError
from tools.pictures.band_writer import FORMATS, write_picture_bands
from tools.pictures.encoders import regrouped
from tools.pictures.writer import CAMERA, POSSIBLE, PictureKind, write_picture

CALIBRATION = SensorCalibration(neutral=(0.5, 1.0, 0.7))
METADATA = CaptureMetadata(make="Acme", model="Käthe 3", iso=400)
KINDS = [PictureKind(name, bits, space) for name in FORMATS for space, depths in POSSIBLE[name].items() for bits in depths]


def scene(shape: tuple[int, int], channels: int = 3) -> FloatArray:
    return np.random.default_rng(0).uniform(-0.1, 1.3, (*shape, channels)).astype(np.float32)


def cut(rgb: FloatArray, rows: int) -> Iterator[FloatArray]:
    return (rgb[top : top + rows].copy() for top in range(0, len(rgb), rows))


@pytest.mark.parametrize("kind", KINDS, ids=str)
@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize(("shape", "rows"), [((1, 1), 1), ((130, 33), 7), ((200, 70), 64), ((65, 129), 100), ((90, 20), 1000)])
def test_the_same_bytes(tmp_path: Path, kind: PictureKind, orientation: int, shape: tuple[int, int], rows: int) -> None:
    rgb, metadata = scene(shape), replace(METADATA, orientation=orientation)
    write_picture(tmp_path / "whole.tif", rgb, kind, calibration=CALIBRATION, metadata=metadata, exposure=0.0)
    write_picture_bands(tmp_path / "bands.tif", cut(rgb, rows), shape, kind, calibration=CALIBRATION, metadata=metadata)
    assert (tmp_path / "bands.tif").read_bytes() == (tmp_path / "whole.tif").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bands.tif", "whole.tif"]


@pytest.mark.parametrize(
    "kind", [PictureKind("tif", 8, "srgb"), PictureKind.of("jpg"), PictureKind.of("uhdr"), PictureKind.of("dng")], ids=str
)
def test_any_number_of_threads_writes_the_same_bytes(tmp_path: Path, kind: PictureKind) -> None:
    shape = (700, 50)
    for threads in (1, 3):
        bands, path = cut(scene(shape), 90), tmp_path / str(threads)
        write_picture_bands(path, bands, shape, kind, calibration=CALIBRATION, metadata=METADATA, threads=threads)
    assert (tmp_path / "1").read_bytes() == (tmp_path / "3").read_bytes()


@pytest.mark.parametrize("name", ["tif", "jpg", "uhdr", "dng"])
@pytest.mark.parametrize("restored", [True, False])
def test_the_same_bytes_of_what_is_burnt_out(tmp_path: Path, name: str, restored: bool) -> None:
    rgb, kind = 4 * scene((70, 30)), PictureKind.of(name)
    how: Any = {"calibration": CALIBRATION, "metadata": METADATA, "exposure": 0.0 if name == "dng" else -3.0, "restored": restored}
    write_picture(tmp_path / "whole", rgb, kind, **how)
    for rows, threads in ((9, 1), (33, 3)):
        write_picture_bands(tmp_path / f"{rows}", cut(rgb, rows), (70, 30), kind, **how, threads=threads)
        assert (tmp_path / f"{rows}").read_bytes() == (tmp_path / "whole").read_bytes()


def test_the_same_bytes_of_other_channels_and_exposure(tmp_path: Path) -> None:
    cyan, rgb = SensorCalibration(channels="CYMG"), scene((70, 30), 4)
    kind = PictureKind("tif", 32, CAMERA)
    write_picture(tmp_path / "whole.tif", rgb, kind, calibration=cyan, metadata=METADATA)
    write_picture_bands(tmp_path / "bands.tif", cut(rgb, 9), (70, 30), kind, calibration=cyan, metadata=METADATA)
    assert (tmp_path / "bands.tif").read_bytes() == (tmp_path / "whole.tif").read_bytes()
    kind, rgb = PictureKind("tif", 16, "srgb"), rgb[..., :3]
    write_picture(tmp_path / "b.tif", rgb, kind, calibration=CALIBRATION, metadata=METADATA, exposure=1.5)
    write_picture_bands(tmp_path / "c.tif", cut(rgb, 9), (70, 30), kind, calibration=CALIBRATION, metadata=METADATA, exposure=1.5)
    assert (tmp_path / "b.tif").read_bytes() == (tmp_path / "c.tif").read_bytes()


def fails() -> Iterator[FloatArray]:
    yield scene((10, 20))
    raise ConvergenceError("no further")


@pytest.mark.parametrize("orientation", [1, 6])
@pytest.mark.parametrize("overwrite", [False, True])
def test_nothing_is_left_of_a_rendering_that_fails(tmp_path: Path, orientation: int, overwrite: bool) -> None:
    path = tmp_path / "picture.tif"
    if overwrite:
        path.write_bytes(b"old")
    metadata = replace(METADATA, orientation=orientation)
    kind = PictureKind.of("tif")
    with pytest.raises(ConvergenceError):
        write_picture_bands(path, fails(), (30, 20), kind, calibration=CALIBRATION, metadata=metadata, overwrite=overwrite)
    assert list(tmp_path.iterdir()) == ([path] if overwrite else [])
    assert not overwrite or path.read_bytes() == b"old"


def test_a_full_disk_is_named(tmp_path: Path, full_disk: Callable[[], None]) -> None:
    full_disk()
    path, bands, kind = tmp_path / "picture.tif", cut(scene((9, 9)), 4), PictureKind.of("tif")
    with pytest.raises(OutputError, match=r"picture\.tif: the disk is full"):
        write_picture_bands(path, bands, (9, 9), kind, calibration=CALIBRATION, metadata=METADATA)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["png", "exr", "npy"])
def test_other_formats_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"{name} cannot be written in parts; use tif"):
        write_picture_bands(tmp_path / "picture", [], (9, 9), PictureKind.of(name), calibration=CALIBRATION, metadata=METADATA)


@pytest.mark.parametrize("heights", [[], [5], [64], [1, 63, 64, 65], [7] * 30, [200]])
def test_regrouped_rows_are_the_same_rows(heights: list[int]) -> None:
    rows = np.arange(sum(heights) * 3).reshape(-1, 1, 3)
    bands = np.split(rows, np.cumsum(heights)[:-1]) if heights else []
    found = list(regrouped(bands, 64))
    assert [len(band) for band in found] == [64] * (len(rows) // 64) + [len(rows) % 64] * (len(rows) % 64 > 0)
    if found:
        assert np.array_equal(np.concatenate(found), rows)
