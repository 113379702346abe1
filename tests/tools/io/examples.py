"""Small pictures, and how they are written."""

from dataclasses import replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import rawpy

from panchroma.shared import DoubleArray, FloatArray, SensorCalibration
from panchroma.tools.io.development import Development
from panchroma.tools.io.display import ColourTransform, upright
from panchroma.tools.io.formats import FORMATS
from panchroma.tools.io.kind import PictureKind, write_picture
from tests.shared.dng import examples

CALIBRATION = SensorCalibration(neutral=(0.5, 1.0, 0.7))
FOUR = SensorCalibration(
    channels="RGBE",
    neutral=(0.5, 1.0, 0.6, 0.9),
    camera_to_xyz=((0.9, 0.2, 0.1, 0.1), (0.4, 0.6, -0.1, 0.1), (0.0, -0.1, 1.0, 0.2)),
)
"""A sensor of four channels with a colour matrix."""
# exiftool would ask by which method they were found
METADATA = replace(examples.METADATA, place=None, altitude=None)
SIZES = [(1, 1), (1, 7), (7, 1), (65, 3), (64, 5), (130, 33)]  # strips of a TIFF are 64 rows
KINDS = [
    PictureKind(name, bits, space)
    for name, written in FORMATS.items()
    for space, depths in written.spaces.items()
    for bits in depths
]


def scene(shape: tuple[int, int], channels: int = 3, seed: int = 0) -> FloatArray:
    """Random scene units, some below black and past white."""
    return np.random.default_rng(seed).uniform(-0.1, 1.3, (*shape, channels)).astype(np.float32)


def development(
    kind: PictureKind, shape: tuple[int, ...], orientation: int = 6, **changed: Any
) -> Development:
    """How a rendering of `shape` becomes a picture; changed: fields of it."""
    metadata = replace(METADATA, orientation=orientation)
    return replace(Development(kind, (shape[0], shape[1]), CALIBRATION, metadata), **changed)


def encode_picture(rgb: FloatArray, development: Development) -> bytes:
    """The content of the file that `write_picture` writes."""
    with TemporaryDirectory() as folder:
        write_picture(path := Path(folder) / "picture", [rgb], development)
        return path.read_bytes()


def encoded(rgb: FloatArray, kind: PictureKind, orientation: int = 6, **changed: Any) -> BytesIO:
    """The file of a picture; changed: fields of its development."""
    return BytesIO(encode_picture(rgb, development(kind, rgb.shape, orientation, **changed)))


def picture_dng(rgb: FloatArray) -> bytes:
    """A rendered picture (H, W, 3) as a linear DNG."""
    return encoded(rgb, PictureKind.of("dng")).getvalue()


def developed(file: str | BytesIO) -> DoubleArray:
    """Return a DNG in linear sRGB, 0..1, as LibRaw renders it with the white balance of the shot."""
    with rawpy.imread(file) as raw:
        # LibRaw brightens pictures whose maximum is not quite white unless told not to.
        plain: Any = {"gamma": (1, 1), "no_auto_bright": True, "adjust_maximum_thr": 0.0}
        return raw.postprocess(use_camera_wb=True, output_bps=16, user_flip=0, **plain) / 65535


def shown(rgb: FloatArray, space: str, orientation: int) -> FloatArray:
    """A picture as the file is to show it, before it is quantised."""
    return upright(ColourTransform.to_space(CALIBRATION, space).apply(rgb), orientation)
