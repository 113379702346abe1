"""Pictures: which numbers are light already, and which are made light.

Files that hold several pictures: the full one is the scene, and a note names what is left out,
but for previews and smaller copies.

Scenes with other channels than red, green and blue: the same light from every format, and what
is none of it.
"""

import struct
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import imagecodecs
import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image, ImageCms

from panchroma.shared.colorimetry import D65_XY, SRGB_PRIMARIES, SRGB_TO_XYZ
from panchroma.shared.errors import InputError
from panchroma.tools.io import decoders
from panchroma.tools.io.scene import Scene
from panchroma.tools.simulation.load import load_scene
from tests.tools.io.files import ASCII, BYTE, CFA, LINEAR_RAW, LONG, SHORT, iccp, noise, png, save

# --- picture --------------------------------------------------------------------------------------

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


@pytest.mark.parametrize(("suffix", "channels"), [*product([".tif", ".npy"], [0, 1]), (".tif", 2)])
def test_grey_becomes_three_alike_and_transparency_goes(
    tmp_path: Path, suffix: str, channels: int
) -> None:
    grey, path = ramp(np.uint16, 10, 20)[..., 0], tmp_path / f"a{suffix}"
    stored = np.stack([grey, grey // 2], axis=2)[..., :channels] if channels else grey
    if suffix == ".npy":
        np.save(path, stored)
    else:
        extra, planes = (["unassalpha"], "contig") if channels == 2 else (None, None)
        layout: Any = {"photometric": "minisblack", "planarconfig": planes}
        tifffile.imwrite(path, stored, extrasamples=extra, **layout)
    scene = load_scene(str(path))
    np.testing.assert_allclose(scene.rgb, (grey / 65535)[..., None].repeat(3, axis=2), atol=1e-7)
    assert ("transparency is left out" in scene.notes) == (channels == 2)


def test_a_profile_of_tables_is_followed(tmp_path: Path) -> None:
    cube = np.moveaxis(np.indices((2, 2, 2)), 0, -1).astype(float)
    corners = cube @ np.array(SRGB_TO_XYZ).T
    corners[1, 1, 0] *= 0.8  # yellow is darker than red and green together
    picture = (255 * cube).astype(np.uint8, order="C").reshape(2, 4, 3)
    scene = load_scene(png(tmp_path / "a.png", picture, iCCP=iccp(table_profile(corners))))
    xyz = scene.rgb @ np.array(scene.camera_to_xyz).T
    np.testing.assert_allclose(xyz, corners.reshape(2, 4, 3), atol=1e-3)
    assert scene.notes == ()


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


# --- several pictures -----------------------------------------------------------------------------

DEPTH, SEMANTIC, ENHANCED = 8, 65540, 16
_UNUSED = 32  # in place of SEMANTIC, which tifffile takes for a mask of one bit
DNG: list[Any] = [(50706, BYTE, 4, (1, 4, 0, 0), True), (50708, ASCII, 0, "Test camera", True)]
BAYER: list[Any] = [(33421, SHORT, 2, (2, 2), True), (33422, BYTE, 4, (0, 1, 1, 2), True)]


class Page(NamedTuple):
    """A page of a TIFF: samples, NewSubfileType, PhotometricInterpretation."""

    samples: Any
    kind: int = 0
    photometric: int = 2


def colours(rows: int, columns: int, kind: int = 0) -> Page:
    return Page(noise(rows, columns, 3), kind)


def grey(rows: int, columns: int, kind: int = 0) -> Page:
    return Page(noise(rows, columns), kind, 1)


def mask(rows: int, columns: int, kind: int = 4) -> Page:
    return Page(noise(rows, columns) > 2000, kind, 4)


def mosaic(rows: int = 60, columns: int = 80) -> Page:
    return Page(noise(rows, columns), 0, CFA)


def linear(rows: int = 60, columns: int = 80, kind: int = 0) -> Page:
    return Page(noise(rows, columns, 3), kind, LINEAR_RAW)


def write(
    path: Path, first: Page, below: Sequence[Page] = (), then: Sequence[Page] = (), tags: Any = ()
) -> str:
    """Write a TIFF: its first page, pages below that and pages behind it. tags: of the first."""
    with tifffile.TiffWriter(path, byteorder="<") as file:
        for page in (first, *below, *then):
            kind = page.kind if page.kind != SEMANTIC else _UNUSED
            options: dict[str, Any] = {"photometric": page.photometric, "subfiletype": kind}
            options["extratags"] = [*(BAYER if page.photometric == CFA else ())]
            if page.photometric == LINEAR_RAW:
                options["planarconfig"] = "contig"  # tifffile 2026.11 writes separate planes
            if page is first:
                options["subifds"] = len(below)
                options["extratags"] += [*tags]
            file.write(page.samples, metadata=None, **options)
    unused, semantic = (struct.pack("<HHII", 254, LONG, 1, kind) for kind in (_UNUSED, SEMANTIC))
    path.write_bytes(path.read_bytes().replace(unused, semantic))
    return str(path)


PREVIEW, SKY = colours(8, 10, 1), Page(noise(90, 120), SEMANTIC, 52527)
ONLY_FIRST = ("the file has several pages; only the first is used",)


@pytest.mark.parametrize(
    ("pages", "notes"),
    [
        ((PREVIEW, [colours(60, 80)]), ()),
        ((PREVIEW, [colours(30, 40, 1), colours(60, 80)]), ()),
        ((colours(8, 10), [colours(60, 80)]), ()),  # a preview that is not marked
        ((PREVIEW, [], [colours(60, 80)]), ()),
        ((colours(60, 80), [colours(30, 40, 1), colours(15, 20, 1)]), ()),  # a pyramid
        ((colours(60, 80), [], [colours(30, 40, 1), mask(60, 80)]), ("a transparency mask",)),
        ((colours(60, 80), [], [mask(30, 40, 5), grey(60, 80, DEPTH)]), ("a depth map",)),
        ((colours(60, 80), [], [colours(60, 80), colours(60, 80)]), ONLY_FIRST),
        ((colours(60, 80, 2), [], [colours(30, 40, 2)]), ONLY_FIRST),
    ],
)
def test_the_scene_of_a_tiff_is_its_full_picture(tmp_path: Path, pages: Any, notes: Any) -> None:
    scene = load_scene(write(tmp_path / "a.tif", *pages), linear=True)
    np.testing.assert_allclose(scene.rgb, noise(60, 80, 3) / 65535, atol=1e-6)
    expected = notes if notes in ((), ONLY_FIRST) else (f"not used: {notes[0]}",)
    assert tuple(note for note in scene.notes if "no sample is above" not in note) == expected


def test_pages_of_grey_are_a_stack_without_their_smaller_copies(tmp_path: Path) -> None:
    planes = [grey(60, 80) for _ in range(3)]
    copies = [grey(30, 40, 1)]
    path = write(tmp_path / "a.tif", planes[0], copies, [*planes[1:], *copies])
    stacked = load_scene(path, linear=True).rgb
    np.testing.assert_allclose(stacked[..., 1], planes[0].samples / 65535, rtol=1e-6)
    path = write(tmp_path / "b.tif", copies[0], [], planes)
    assert load_scene(path, linear=True).shape == (60, 80)


@pytest.mark.parametrize(
    ("first", "below", "shape", "names"),
    [
        (PREVIEW, [mosaic(), linear(120, 160, ENHANCED)], (30, 40), "an enhanced picture"),
        (mosaic(), [linear(60, 80, ENHANCED)], (30, 40), "an enhanced picture"),
        (colours(200, 300, 1), [mosaic(), grey(90, 70, DEPTH)], (30, 40), "a depth map"),
        (PREVIEW, [SKY, linear(), mask(60, 80)], (60, 80), "a transparency mask, a semantic mask"),
        (linear(), [linear(120, 160, ENHANCED)], (60, 80), "an enhanced picture"),
        (PREVIEW, [linear(), colours(200, 300, 65537)], (60, 80), ""),
    ],
)
def test_the_scene_of_a_dng_is_its_main_picture(
    tmp_path: Path, first: Page, below: list[Page], shape: tuple[int, int], names: str
) -> None:
    scene = load_scene(write(tmp_path / "a.dng", first, below, tags=DNG))
    assert scene.shape == shape
    notes = [note for note in scene.notes if note.startswith("not used")]
    assert notes == ([f"not used: {names}"] if names else [])


def test_the_preview_of_a_raw_is_not_its_scene(tmp_path: Path) -> None:
    """Some cameras' RAWs are named like pictures."""
    pages = PREVIEW, [mosaic(), colours(30, 40, 1)]
    assert load_scene(write(tmp_path / "a.tif", *pages)).shape == (30, 40)
    with pytest.raises(InputError):
        load_scene(write(tmp_path / "b.tif", pages[0], [], pages[1]))
    path = Path(write(tmp_path / "c.dng", *pages, tags=DNG))
    entry = struct.pack("<HHII", 259, SHORT, 1, 1)
    data = path.read_bytes()
    for unknown in (52546, 34713, 9):  # JPEG XL, Nikon's and JBIG of a mosaic
        at = data.index(entry, data.index(entry) + 1)
        changed = struct.pack("<HHII", 259, SHORT, 1, unknown)
        path.write_bytes(data[:at] + changed + data[at + len(entry) :])
        with pytest.raises(InputError):
            load_scene(str(path))


def test_pictures_behind_the_first_one_of_a_jpeg_are_told(tmp_path: Path) -> None:
    pictures = [Image.fromarray(noise(40, 60, 3, dtype=np.uint8)) for _ in range(3)]
    path = tmp_path / "a.jpg"
    pictures[0].save(path, format="MPO", save_all=True, append_images=pictures[1:])
    (note,) = load_scene(str(path)).notes
    assert note == "not used: 2 more in the file: only the first picture is"
    data = bytearray(path.read_bytes())
    # the entries lie behind the directory, whose last field they are
    first = data.index(struct.pack("<HHI", 0xB002, 7, 48)) + 16
    assert struct.unpack_from("<I", data, first) == (0x30000,)
    previews = []
    for entry in (first + 16, first + 32):  # previews in full HD, as many cameras write them
        struct.pack_into("<I", data, entry, 0x10002)
        path.write_bytes(data)
        previews.append(load_scene(str(path)).notes)
    assert previews == [("not used: 1 more in the file: only the first picture is",), ()]


def test_an_animation_is_told(tmp_path: Path) -> None:
    path = png(tmp_path / "a.png", noise(40, 60, 3, dtype=np.uint8), acTL=struct.pack(">II", 2, 0))
    assert load_scene(path).notes == ("not used: the animation",)


def test_the_part_of_an_exr_that_has_colours_is_the_scene(tmp_path: Path) -> None:
    light = noise(40, 60, 4).astype(np.float32) / 4096
    named = dict(zip("RGBA", np.moveaxis(light, 2, 0).copy(), strict=True))
    adobe = {"chromaticities": (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.329)}
    depth, rgb = {"Z": light[..., 0].copy()}, {name: named[name] for name in "RGB"}
    planes = {"depth": depth, "sun": named, "other": rgb}
    parts = [OpenEXR.Part(dict(adobe), channels, name) for name, channels in planes.items()]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    scene = load_scene(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(scene.rgb, light[..., :3])
    assert np.array(scene.camera_to_xyz)[0, 0] > 0.5  # Adobe RGB's
    assert scene.notes == ("not used: the channels A, 2 more parts of the EXR",)
    OpenEXR.File(parts[:1]).write(str(tmp_path / "b.exr"))
    with pytest.raises(InputError, match="has the channels Z"):
        load_scene(str(tmp_path / "b.exr"))


# --- channels -------------------------------------------------------------------------------------

BANDS = "VRNGU"
LIGHT = np.random.default_rng(3).random((21, 34, 5), np.float32)


def pages(path: Path, light: Any, **options: Any) -> Path:
    with tifffile.TiffWriter(path) as file:
        for plane in np.moveaxis(light, -1, 0).copy():
            file.write(plane, photometric="minisblack", contiguous=False, **options)
    return path


def load(path: Path, channels: str = BANDS) -> Scene:
    return load_scene(str(path), channels=channels)


def tiff(path: Path, light: Any, **options: Any) -> Path:
    tifffile.imwrite(path, light, photometric="minisblack", **options)
    return path


PLANES = np.moveaxis(LIGHT, -1, 0).copy()
WRITERS: dict[str, Callable[[Path], Path]] = {
    "npy": lambda path: save(path.with_suffix(".npy"), LIGHT),
    "exr": lambda path: save(path.with_suffix(".exr"), LIGHT, BANDS),
    "contig": lambda path: tiff(path, LIGHT, planarconfig="contig"),
    "planar": lambda path: tiff(path, PLANES, planarconfig="separate", compression="deflate"),
    "pages": lambda path: pages(path, LIGHT, compression="lzw"),
    "series": lambda path: tiff(path, PLANES),
    "tiles": lambda path: pages(path, LIGHT, tile=(16, 16)),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_all_formats_hold_the_same_light(tmp_path: Path, kind: str) -> None:
    scene = load(WRITERS[kind](tmp_path / "a.tif"))
    assert np.array_equal(scene.rgb, LIGHT)
    assert (scene.channels, scene.camera_to_xyz, scene.neutral) == (BANDS, None, (1.0,) * 5)
    named = ["in this order" in note and "V, R, N, G, U" in note for note in scene.notes]
    assert named == ([] if kind == "exr" else [True])


def test_four_samples_are_bands_where_four_are_wanted_and_none_is_transparency(
    tmp_path: Path,
) -> None:
    four, short = LIGHT[..., :4], (LIGHT[..., :4] * 65535).astype(np.uint16)
    tiff(tmp_path / "bands.tif", four, planarconfig="contig")
    tifffile.imwrite(tmp_path / "alpha.tif", short, photometric="rgb", extrasamples=["unassalpha"])
    for path in (save(tmp_path / "a.npy", four), tmp_path / "bands.tif"):
        assert np.array_equal(load(path, "VRNG").rgb, four)
        assert load(path, "CMYG").channels == "CMYG"
    for channels in ("RGB", "VRNG"):
        plain = load(tmp_path / "alpha.tif", channels)
        assert (plain.channels, plain.notes[0]) == ("RGB", "transparency is left out")
    for kind, samples in (("rgb", short), ("minisblack", short[..., :2])):
        path, extra = tmp_path / f"{kind}.tif", ["unspecified"]
        tifffile.imwrite(path, samples, photometric=kind, extrasamples=extra, planarconfig="contig")
        with pytest.raises(InputError, match=r"declare transparency \(ExtraSamples"):
            load(path, "RGB")
    two = save(tmp_path / "two.npy", LIGHT[..., :2])
    assert load(two, "RN").channels == "RN"
    for path in (two, tmp_path / "a.npy", tmp_path / "bands.tif"):
        with pytest.raises(InputError, match="leave others out"):
            load(path, "RGB")


def test_three_are_red_green_and_blue_where_these_can_make_the_filters(tmp_path: Path) -> None:
    three = LIGHT[..., :3]
    for path in (save(tmp_path / "a.npy", three), pages(tmp_path / "a.tif", three)):
        for channels in ("RGB", "CMY", "RGBY", "CM"):
            assert load(path, channels).channels == "RGB"
            assert np.array_equal(load(path, channels).rgb, three)
        assert load(path, "VRN").channels == "VRN"
    tifffile.imwrite(tmp_path / "colour.tif", three, photometric="rgb")
    assert load(tmp_path / "colour.tif", "VRN").channels == "RGB"


def test_an_exr_has_its_channels_by_name(tmp_path: Path) -> None:
    path = save(tmp_path / "a.exr", LIGHT, "RGBNA")
    assert np.array_equal(load(path, "RGB").rgb, LIGHT[..., :3])
    assert np.array_equal(load(path, "NG").rgb, LIGHT[..., [3, 1]])
    assert load(path, "NG").notes == ("not used: the channels A, B, R",)
    assert load(path, "RGBNA").notes == ()
    mixed = load(path, "CMYN")  # C, M and Y from R, G and B
    assert (mixed.channels, mixed.neutral) == ("RGBN", (1.0,) * 4)
    assert np.array(mixed.camera_to_xyz).any(axis=0).tolist() == [True, True, True, False]
    assert load(save(tmp_path / "b.exr", LIGHT[..., :3], "CMY"), "CMY").channels == "CMY"
    message = "the EXR has the channels N, U; expected N, V, or R, G, B, or Y alone"
    with pytest.raises(InputError, match=message):
        load(save(tmp_path / "c.exr", LIGHT[..., :2], "NU"), "NV")


def test_pages_count_as_channels_of_a_bomb(tmp_path: Path) -> None:
    """Each alone is a harmless even picture."""
    even = np.broadcast_to(np.uint16(0), (1800, 3600, 8))
    path = pages(tmp_path / "a.tif", even, compression="deflate", rowsperstrip=1800)
    with pytest.raises(InputError, match="made to fill the memory"):
        load(path, "ABCDEFGH")


def test_even_light_has_any_channels() -> None:
    for source, value in (("flat:20x10", 1), ("dark:20x10", 0)):
        scene = load_scene(source, channels=BANDS)
        assert scene.channels == BANDS
        assert (scene.rgb == value).all()
        assert load_scene(source, channels="CMY").channels == "RGB"
        assert load_scene(source, channels="CMYN").channels == "RGBN"
