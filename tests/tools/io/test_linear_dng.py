"""The rendered picture as a DNG, opened with LibRaw as a raw developer opens it."""

import struct
from io import BytesIO

import numpy as np
import pytest
import rawpy

from panchroma.shared import SensorCalibration
from panchroma.shared.colorimetry import SRGB_TO_XYZ, as_rows
from panchroma.shared.dng import codec
from panchroma.shared.dng.tags import TAG
from panchroma.shared.errors import InputError
from panchroma.shared.tiff import FieldType
from tests.tools.io.examples import developed, picture_dng

PATCH = 16
# of full scale: two roundings to 16 bits, and LibRaw's matrix in floats of four digits
QUANTISED = 1e-4
NEUTRAL = np.array([0.5, 1.0, 0.7])


@pytest.mark.parametrize("shape", [(22, 23), (64, 301), (520, 37), (300, 160)])
def test_libraw_reads_the_very_codes_and_black_and_white_beyond_them(
    shape: tuple[int, int],
) -> None:
    rgb = np.random.default_rng(1).random((*shape, 3), np.float32)
    rgb[0, 0], rgb[0, 1] = (0.0, 1.0, 0.5), (-0.5, 2.0, 1e9)
    codes = np.rint(rgb.clip(0, 1) * 65535).astype(np.uint16)
    with rawpy.imread(BytesIO(picture_dng(rgb))) as raw:
        np.testing.assert_array_equal(raw.raw_image[..., :3], codes)
        assert raw.white_level == 65535
        assert raw.sizes.flip == 6  # LibRaw's word for orientation 6


def test_calibrated_colours_are_kept() -> None:
    crosstalk = np.array([[1.2, -0.1, -0.1], [0.1, 0.8, 0.1], [0.0, 0.2, 0.8]])  # white to white
    camera_to_xyz = SRGB_TO_XYZ @ crosstalk / NEUTRAL
    patches = np.random.default_rng(3).uniform(0.3, 0.7, (6, 5, 3)) * NEUTRAL
    camera = patches.repeat(PATCH, axis=0).repeat(PATCH, axis=1).astype(np.float32)
    calibration = SensorCalibration(neutral=tuple(NEUTRAL), camera_to_xyz=as_rows(camera_to_xyz))
    shown = developed(BytesIO(picture_dng(camera, calibration)))
    middles = slice(PATCH // 2, None, PATCH)
    expected = patches / NEUTRAL @ crosstalk.T
    np.testing.assert_allclose(shown[middles, middles], expected, atol=QUANTISED)


def test_a_picture_that_is_not_finite_is_refused() -> None:
    with pytest.raises(InputError, match="not finite"):
        picture_dng(np.full((4, 4, 3), np.nan, np.float32))


def test_a_changed_shape_of_a_rendered_picture_is_told() -> None:
    data = picture_dng(np.random.default_rng(4).random((8, 12, 3), np.float32))
    assert codec.verify(data) == (8, 12)
    turned = data
    for name, old, new in (("ImageWidth", 12, 8), ("ImageLength", 8, 12), ("RowsPerStrip", 8, 12)):
        entry = struct.pack("<HHI", TAG[name], FieldType.LONG, 1)
        turned = turned.replace(entry + struct.pack("<I", old), entry + struct.pack("<I", new))
    assert turned != data
    with pytest.raises(InputError, match="damaged"):
        codec.verify(turned)
