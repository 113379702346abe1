"""Samples of picture files: integer codes, turned upright."""

import numpy as np
import pytest
from PIL import Image, ImageOps

from shared.colorimetry import decode_srgb, encode_srgb
from shared.errors import InputError
from tools.pictures.samples import quantise, upright

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
