"""ICC profiles that we write: other programs read them as we mean them."""

import io

import numpy as np
import pytest
from PIL import Image, ImageCms

from panchroma.tools.io.colour import decode_srgb, encode_srgb
from panchroma.tools.io.display import SPACES, quantise
from panchroma.tools.io.icc import icc_profile


@pytest.mark.parametrize("name", SPACES)
def test_a_colour_engine_reads_the_profile_as_we_mean_it(name: str) -> None:
    """LittleCMS, from our profile to its own sRGB, against our matrix and curves: greys and random
    colours, within one code.
    """
    codes = np.random.default_rng(4).integers(0, 256, (33, 256, 3), np.uint8)
    codes[0] = np.arange(256)[:, None]
    converted = ImageCms.profileToProfile(
        Image.fromarray(codes),
        profile := ImageCms.ImageCmsProfile(io.BytesIO(icc_profile(name))),
        ImageCms.createProfile("sRGB"),
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )
    encoded = codes.astype(np.float32) / np.float32(255)
    linear = encoded if SPACES[name].linear else decode_srgb(encoded)
    in_srgb = linear @ (np.linalg.inv(SPACES["srgb"].to_xyz) @ SPACES[name].to_xyz).T
    expected = quantise(encode_srgb(in_srgb.astype(np.float32)), 8)
    assert np.abs(np.asarray(converted).astype(int) - expected).max() <= 1
    assert ImageCms.getProfileDescription(profile) == SPACES[name].title + "\n"
