"""Pictures: which numbers are light already, and which are made light."""

import struct
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import ImageCms

from panchroma.shared.colorimetry import D65_XY, SRGB_PRIMARIES, SRGB_TO_XYZ
from panchroma.shared.errors import InputError
from panchroma.tools.io import decoders
from panchroma.tools.io.icc import read_profile
from panchroma.tools.simulation.load import load_scene
from tests.tools.io.files import iccp, png, save

SRGB_PROFILE: bytes = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def gamma_profile(gamma: float) -> bytes:
    """An ICC profile of a power, and the primaries of sRGB."""
    corners = [part for x, y in SRGB_PRIMARIES for part in (x, y, 1)]
    white = [*D65_XY, 1]
    return imagecodecs.cms_profile("rgb", whitepoint=white, primaries=corners, gamma=gamma)


def table_profile(corners: np.ndarray[Any, Any]) -> bytes:
    """An ICC profile of a table (mft2): XYZ at the corners of the cube, (2, 2, 2, 3), red first."""
    matrix = struct.pack(">9i", *(np.eye(3).astype(int) * 65536).ravel())
    ramps = struct.pack(">6H", *(0, 65535) * 3)
    nodes = np.rint(corners * 32768).astype(">u2").tobytes()
    element = b"mft2\0\0\0\0\3\3\2\0" + matrix + struct.pack(">2H", 2, 2) + ramps + nodes + ramps
    header = bytearray(128)
    header[:4], header[8:12] = (144 + len(element)).to_bytes(4, "big"), b"\x02\x40\0\0"
    header[12:24], header[36:40] = b"mntrRGB XYZ ", b"acsp"
    return bytes(header) + struct.pack(">I4sII", 1, b"A2B0", 144, len(element)) + element


LINEAR_PROFILE, GAMMA_18 = gamma_profile(1), gamma_profile(1.8)


def ramp(dtype: type, rows: int = 12, columns: int = 16) -> np.ndarray[Any, Any]:
    top = np.iinfo(dtype).max
    picture = np.random.default_rng(4).integers(0, top, (rows, columns, 3), dtype, endpoint=True)
    picture[0, 0], picture[0, 1] = 0, top
    return picture


def srgb(encoded: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """IEC 61966-2-1, as printed."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".npy"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("linear", [False, True])
def test_8_bits_are_srgb_and_16_linear_with_a_note_unless_linear_is_said(
    tmp_path: Path, suffix: str, dtype: type, linear: bool
) -> None:
    picture = ramp(dtype)
    scene = load_scene(str(save(tmp_path / f"a{suffix}", picture)), linear=linear)
    encoded = picture / np.iinfo(dtype).max
    expected = srgb(encoded) if dtype == np.uint8 and not linear else encoded
    np.testing.assert_allclose(scene.rgb, expected, atol=1e-7)
    assert (scene.camera_to_xyz, scene.neutral) == (SRGB_TO_XYZ, (1.0, 1.0, 1.0))
    assert len(scene.notes) == (dtype == np.uint16 and not linear)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("suffix", [".tif", ".npy", ".exr"])
def test_floating_point_is_scene_units(tmp_path: Path, dtype: type, suffix: str) -> None:
    stored = np.float32 if suffix == ".exr" and dtype == np.float64 else dtype  # EXR has no double
    picture: Any = np.random.default_rng(0).uniform(0, 0.9, (12, 16, 3)).astype(stored)
    scene = load_scene(str(save(tmp_path / f"a{suffix}", picture)))
    np.testing.assert_array_equal(scene.rgb, picture.astype(np.float32))
    assert scene.notes == ()


@pytest.mark.parametrize("channels", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("suffix", [".tif", ".npy"])
def test_grey_becomes_three_alike_and_transparency_goes(
    tmp_path: Path, suffix: str, channels: int
) -> None:
    if suffix == ".npy" and channels in (2, 4):
        return  # an array says nothing of transparency
    picture = ramp(np.uint16, 10, 20)[..., :1].repeat(max(channels, 1), axis=2)
    picture[..., -1:] = picture[..., -1:] // 2 if channels in (2, 4) else picture[..., -1:]
    stored = picture[..., 0] if channels == 0 else picture
    path = tmp_path / f"a{suffix}"
    if suffix == ".npy":
        np.save(path, stored)
    else:
        extra = ["unassalpha"] if channels in (2, 4) else None
        kind, planes = "rgb" if channels > 2 else "minisblack", "contig" if channels > 1 else None
        tifffile.imwrite(path, stored, photometric=kind, extrasamples=extra, planarconfig=planes)
    scene = load_scene(str(path))
    np.testing.assert_allclose(scene.rgb, (picture[..., :1] / 65535).repeat(3, axis=2), atol=1e-7)
    assert ("transparency is left out" in scene.notes) == (channels in (2, 4))


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("gamma", [1.8, 1.0])
def test_a_profile_is_believed(tmp_path: Path, suffix: str, dtype: type, gamma: float) -> None:
    picture, path = ramp(dtype), tmp_path / f"a{suffix}"
    icc = LINEAR_PROFILE if gamma == 1 else GAMMA_18
    if suffix == ".tif":
        tifffile.imwrite(path, picture, photometric="rgb", iccprofile=icc)
    else:
        png(path, picture, iCCP=iccp(icc))
    scene = load_scene(str(path))
    np.testing.assert_allclose(scene.rgb, (picture / np.iinfo(dtype).max) ** gamma, atol=2e-6)
    assert scene.notes == ()
    forced = load_scene(str(path), linear=True)
    np.testing.assert_allclose(forced.rgb, picture / np.iinfo(dtype).max, atol=1e-6)
    assert bool(forced.notes) == (gamma != 1)


def test_a_profile_of_tables_is_followed(tmp_path: Path) -> None:
    cube = np.moveaxis(np.indices((2, 2, 2)), 0, -1).astype(float)
    corners = cube @ np.array(SRGB_TO_XYZ).T
    corners[1, 1, 0] *= 0.8  # yellow is darker than red and green together
    picture = (255 * cube).astype(np.uint8, order="C").reshape(2, 4, 3)
    scene = load_scene(png(tmp_path / "a.png", picture, iCCP=iccp(table_profile(corners))))
    xyz = scene.rgb @ np.array(scene.camera_to_xyz).T
    np.testing.assert_allclose(xyz, corners.reshape(2, 4, 3), atol=1e-3)
    assert scene.notes == ()


def test_a_profile_that_cannot_be_read_is_ignored_and_said(tmp_path: Path) -> None:
    assert read_profile(b"") is None
    for broken in (b"nonsense", SRGB_PROFILE[:100], SRGB_PROFILE[:200]):
        assert read_profile(broken) is None
        tifffile.imwrite(tmp_path / "a.tif", ramp(np.uint8), photometric="rgb", iccprofile=broken)
        assert any("profile" in note for note in load_scene(str(tmp_path / "a.tif")).notes)


def test_the_size_of_an_exr_is_checked_before_it_is_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, decoded = tmp_path / "a.exr", OpenEXR.File
    OpenEXR.File({}, {"RGB": np.ones((6, 8, 3), np.float32)}).write(str(path))

    def header_alone(name: str, header_only: bool = False, **_: object) -> object:
        assert header_only
        return decoded(name, header_only=True)

    monkeypatch.setattr(OpenEXR, "File", header_alone)
    with pytest.raises(InputError, match="8 x 6"):
        decoders.unpack_exr(str(path), 47, "RGB")
