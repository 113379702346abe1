"""What files declare of their colours is used, in the order of their standards; what is not used is
said in one note.
"""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from panchroma.shared import InputError
from panchroma.shared.colorimetry import SRGB_TO_XYZ, primaries_to_xyz
from panchroma.tools.io.colour import P3_PRIMARIES, encode_srgb
from panchroma.tools.io.scene import Scene
from panchroma.tools.simulation.load import load_scene
from tests.tools.io.files import LINEAR_RAW, iccp, png, rationals, write_dng
from tests.tools.io.test_picture import GAMMA_18, LINEAR_PROFILE, SRGB_PROFILE

D65 = (0.3127, 0.3290)
BT2020 = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046))
ADOBE = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06))
RNG = np.random.default_rng(8)
LIGHT = RNG.uniform(0.02, 0.4, (12, 16, 3))  # of BT.709's primaries: less than 1 in all others


def in_space(primaries: Any, light: Any = LIGHT) -> np.ndarray[Any, Any]:
    return light @ (np.linalg.inv(primaries_to_xyz(primaries)) @ SRGB_TO_XYZ).T


def srgb(light: Any) -> Any:
    return encode_srgb(np.asarray(light, np.float32))


def bt709(light: Any) -> Any:
    return np.where(light < 0.018, 4.5 * light, 1.099 * light**0.45 - 0.099)


def codes(encoded: Any, dtype: Any = np.uint16) -> Any:
    return np.rint(encoded * np.iinfo(dtype).max).astype(dtype)


def chrm(primaries: Any, white: Any = D65) -> bytes:
    return struct.pack(">8I", *(round(100000 * value) for value in (*white, *np.ravel(primaries))))


def gama(gamma: float) -> bytes:
    return struct.pack(">I", round(100000 * gamma))


def check(scene: Scene, light: Any = LIGHT, tolerance: float = 1e-3) -> None:
    """The colours of the scene are those of `light` in BT.709's primaries."""
    xyz, expected = scene.rgb @ np.transpose(scene.camera_to_xyz), light @ np.transpose(SRGB_TO_XYZ)
    np.testing.assert_allclose(xyz, expected, atol=tolerance)


SRGB_16, ADOBE_16 = codes(srgb(LIGHT)), codes(in_space(ADOBE) ** (256 / 563))


@pytest.mark.parametrize(
    ("samples", "chunks", "notes"),
    [
        (codes(srgb(in_space(P3_PRIMARIES))), {"cICP": b"\x0c\x0d\0\1"}, 0),
        (codes(bt709(LIGHT)), {"cICP": b"\x01\x01\0\1"}, 0),
        (codes(in_space(BT2020)), {"cICP": b"\x09\x08\0\1"}, 0),
        (codes((16 + 219 * srgb(LIGHT)) * 256 / 65535), {"cICP": b"\x01\x0d\0\0"}, 0),
        # the order: cICP, iCCP, sRGB, then gAMA and cHRM
        (SRGB_16, {"gAMA": gama(1), "iCCP": iccp(LINEAR_PROFILE), "cICP": b"\x01\x0d\0\1"}, 0),
        (SRGB_16, {"gAMA": gama(1), "iCCP": iccp(SRGB_PROFILE), "cHRM": chrm(ADOBE)}, 0),
        (SRGB_16, {"sRGB": b"\0", "gAMA": gama(1), "cHRM": chrm(ADOBE)}, 0),
        (SRGB_16, {"gAMA": gama(0.45455)}, 0),
        (ADOBE_16, {"gAMA": gama(256 / 563), "cHRM": chrm(ADOBE)}, 0),
        (codes(in_space(ADOBE)), {"gAMA": gama(1), "cHRM": chrm(ADOBE)}, 0),
        (codes(srgb(in_space(ADOBE)), np.uint8), {"cHRM": chrm(ADOBE)}, 0),
        # what is not read is said, and the next counts
        (SRGB_16, {"cICP": b"\x09\x0b\0\1", "sRGB": b"\0"}, 1),
        (SRGB_16, {"cICP": b"\x09\x01\x09\1", "iCCP": iccp(SRGB_PROFILE)}, 1),
        (SRGB_16, {"iCCP": iccp(b"nonsense"), "gAMA": gama(0.45455)}, 1),
        (SRGB_16, {"iCCP": b"profile\0\0no zlib", "gAMA": gama(0.45455)}, 1),
        (SRGB_16, {"iCCP": bytes(5 << 20), "gAMA": gama(0.45455)}, 1),
        (SRGB_16, {"gAMA": gama(0.45455), "cHRM": bytes(32)}, 0),
    ],
    ids=lambda value: "+".join(value) if isinstance(value, dict) else "",
)
def test_chunks_of_png(tmp_path: Path, samples: Any, chunks: dict[str, bytes], notes: int) -> None:
    scene = load_scene(png(tmp_path / "a.png", samples, **chunks))
    check(scene, LIGHT, 4e-3 if samples.dtype == np.uint8 else 1e-3)
    assert len(scene.notes) == notes


@pytest.mark.parametrize(("code", "name"), [(b"\x09\x10\0\1", "PQ"), (b"\x09\x12\0\1", "HLG")])
def test_pq_and_hlg_are_refused(tmp_path: Path, code: bytes, name: str) -> None:
    path = png(tmp_path / "a.png", SRGB_16, cICP=code, iCCP=iccp(SRGB_PROFILE))
    with pytest.raises(InputError, match=f"encoded in {name}; save it as sRGB, or as linear light"):
        load_scene(path)


# --- JPEG ----------------------------------------------------------------------------------------

BLOCKS = RNG.uniform(0.02, 0.4, (3, 4, 3)).repeat(8, axis=0).repeat(8, axis=1)


def jpeg(path: Path, encoded: Any, *segments: tuple[int, bytes], **options: Any) -> Path:
    """A JPEG with more segments: their markers, and what they hold."""
    image = Image.fromarray(codes(encoded, np.uint8))
    image.save(path, "JPEG", quality=100, subsampling=0, **options)
    data, added = path.read_bytes(), b""
    for marker, held in segments:
        added += struct.pack(">BBH", 0xFF, marker, len(held) + 2) + held
    path.write_bytes(data[:2] + added + data[2:])
    return path


def exif(space: int | None, index: str = "") -> bytes:
    block = Image.Exif()
    inside = block.get_ifd(0x8769)
    inside[0x9003] = "2024:05:01 10:00:00"
    if space is not None:
        inside[0xA001] = space
    if index:
        inside[0xA005] = {1: index, 2: b"0100"}
    return block.tobytes()


ADOBE_CODES, SRGB_CODES = in_space(ADOBE, BLOCKS) ** (256 / 563), srgb(BLOCKS)


@pytest.mark.parametrize(
    ("encoded", "stated", "icc", "notes"),
    [
        (ADOBE_CODES, (65535, "R03"), None, 0),
        (ADOBE_CODES, (None, "R03"), None, 0),
        (ADOBE_CODES, (2, ""), None, 0),
        (SRGB_CODES, (1, "R98"), None, 0),
        (SRGB_CODES, (65535, "R98"), None, 0),
        (SRGB_CODES, (65535, ""), None, 1),
        (SRGB_CODES, (65535, "R03"), SRGB_PROFILE, 0),
        (SRGB_CODES, (None, ""), None, 0),
    ],
)
def test_exif_tells_adobe_rgb_unless_a_profile_does(
    tmp_path: Path, encoded: Any, stated: tuple[int | None, str], icc: bytes | None, notes: int
) -> None:
    scene = load_scene(str(jpeg(tmp_path / "a.jpg", encoded, exif=exif(*stated), icc_profile=icc)))
    check(scene, BLOCKS, 0.01)
    assert len(scene.notes) == notes
    assert scene.metadata.taken is not None


def test_a_profile_in_parts_is_joined_and_may_be_overruled(tmp_path: Path) -> None:
    parts = b"\2\2" + GAMMA_18[150:], b"\1\2" + GAMMA_18[:150]
    segments = ((0xE2, b"ICC_PROFILE\0" + part) for part in parts)
    path = str(jpeg(tmp_path / "a.jpg", np.full((8, 8, 3), 0.25), *segments))
    scene, forced = load_scene(path), load_scene(path, linear=True)
    np.testing.assert_allclose(scene.rgb, (64 / 255) ** 1.8, atol=1e-4)
    np.testing.assert_allclose(forced.rgb, 64 / 255, atol=1e-6)
    assert scene.notes == ()
    (note,) = forced.notes
    assert note.endswith("taken as linear light, although the file says its ICC profile")


@pytest.mark.parametrize(
    "content", [b"urn:iso:std:iso:ts:21496:-1\0\0\0", b"http://ns.adobe.com/hdr-gain-map/1.0/"]
)
def test_a_gain_map_is_said_in_one_note(tmp_path: Path, content: bytes) -> None:
    scene = load_scene(str(jpeg(tmp_path / "a.jpg", SRGB_CODES, (0xE2, content))))
    check(scene, BLOCKS, 0.01)
    (note,) = scene.notes
    assert "gain map" in note


# --- TIFF ----------------------------------------------------------------------------------------


PRIMARIES, WHITE = (319, 5, 6, rationals(ADOBE), True), (318, 5, 2, rationals(D65), True)
NO_PRIMARIES = (319, 5, 6, rationals([(0.3, 0.3)] * 3), True)


def transfer(bits: int, tables: int) -> Any:
    ramp = np.rint(65535 * np.linspace(0, 1, 1 << bits) ** (563 / 256)).astype(int).tolist()
    return 301, 3, tables << bits, tuple(ramp * tables), True


@pytest.mark.parametrize(
    ("samples", "tags", "icc", "notes"),
    [
        (ADOBE_16, [transfer(16, 1), PRIMARIES, WHITE], None, 0),
        (ADOBE_16, [transfer(16, 3), PRIMARIES], None, 0),
        ((ADOBE_16 >> 8).astype(np.uint8), [transfer(8, 3), PRIMARIES, WHITE], None, 0),
        (codes(in_space(ADOBE)), [PRIMARIES, WHITE], None, 1),
        (in_space(ADOBE).astype(np.float32), [PRIMARIES, WHITE], None, 0),
        (SRGB_16, [transfer(16, 1), PRIMARIES, WHITE], SRGB_PROFILE, 0),
        (codes(LIGHT), [NO_PRIMARIES], LINEAR_PROFILE, 0),
        (codes(LIGHT), [NO_PRIMARIES], None, 1),
    ],
)
def test_fields_of_tiff(
    tmp_path: Path, samples: Any, tags: list[Any], icc: bytes | None, notes: int
) -> None:
    declared: Any = {"extratags": tags, "iccprofile": icc}
    tifffile.imwrite(tmp_path / "a.tif", samples, photometric="rgb", metadata=None, **declared)
    scene = load_scene(str(tmp_path / "a.tif"))
    check(scene, tolerance=4e-3 if samples.dtype == np.uint8 else 1e-3)
    assert len(scene.notes) == notes


# --- DNG and EXR ---------------------------------------------------------------------------------


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("below", [False, True])
def test_corrections_that_a_dng_asks_for_are_said_in_one_note(
    tmp_path: Path, linear: bool, below: bool
) -> None:
    samples = RNG.integers(200, 4000, (60, 80, 3) if linear else (60, 80)).astype(np.uint16)
    lists = {51009: (7, b"\xff\xff\xff\xff\0\0"), 51022: (7, bytes(4))}
    kind = {"kind": LINEAR_RAW} if linear else {}
    options: Any = {**kind, "above": {} if below else None}
    plain = load_scene(write_dng(tmp_path / "plain.dng", samples, **options))
    asking = load_scene(write_dng(tmp_path / "asking.dng", samples, fields=lists, **options))
    (note,) = set(asking.notes) - set(plain.notes)
    assert "(OpcodeList2, OpcodeList3)" in note
    assert np.array_equal(plain.rgb, asking.rgb)
