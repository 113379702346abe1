"""What goes into picture files: codes, the right way up, and the profile that says what the pixels are."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms, ImageOps

from shared.colorimetry import decode_srgb, encode_srgb
from shared.display import SPACES
from shared.errors import InputError
from tests.exiftool import exiftool
from tools.pictures.icc_writing import icc_profile
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


# --- ICC --------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SPACES)
def test_a_colour_engine_reads_the_profile_as_we_mean_it(name: str) -> None:
    """LittleCMS, from our profile to its own sRGB, against our matrix and curves: greys and random colours, within one code."""
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    codes = np.concatenate([ramp, np.random.default_rng(4).integers(0, 256, (32, 256, 3), np.uint8)])
    converted = ImageCms.profileToProfile(
        Image.fromarray(codes),
        ImageCms.ImageCmsProfile(io.BytesIO(icc_profile(name))),
        ImageCms.createProfile("sRGB"),
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )
    encoded = codes.astype(np.float32) / np.float32(255)
    linear = encoded if SPACES[name].linear else decode_srgb(encoded)
    in_srgb = linear @ (np.linalg.inv(SPACES["srgb"].to_xyz) @ SPACES[name].to_xyz).T
    expected = quantise(encode_srgb(in_srgb.astype(np.float32)), 8)
    assert np.abs(np.asarray(converted).astype(int) - expected).max() <= 1


@pytest.mark.parametrize("name", SPACES)
def test_exiftool_finds_the_profile_valid(name: str, tmp_path: Path) -> None:
    path = tmp_path / "profile.icc"
    path.write_bytes(icc_profile(name))
    report = exiftool("-validate", "-warning", "-a", "-ProfileDescription", path).decode()
    assert "OK" in report
    assert "Warning" not in report
    assert SPACES[name].title in report
