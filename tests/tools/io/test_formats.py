"""Picture files, read back with programs that are not ours. Of Ultra HDR and JPEG XL: the samples,
in which colours they are, and the highlights.

Writing pictures: the bytes do not depend on how a picture is divided into bands.
"""

import errno
import io
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageOps

from panchroma.shared import InputError, OutputError, SensorCalibration
from panchroma.shared.arrays import FloatArray
from panchroma.tools.io.colour import decode_srgb
from panchroma.tools.io.development import CAMERA
from panchroma.tools.io.display import SPACES, ColourTransform, quantise, upright
from panchroma.tools.io.encoding import SRGB, icc_profile
from panchroma.tools.io.formats import FORMATS
from panchroma.tools.io.formats.jpg import GainMap
from panchroma.tools.io.kind import PictureKind, write_picture
from panchroma.tools.simulation.load import load_scene
from tests.exiftool import fields
from tests.tools.io import examples
from tests.tools.io.examples import (
    CALIBRATION,
    FOUR,
    KINDS,
    METADATA,
    development,
    encode_picture,
    encoded,
    scene,
    shown,
)

# --- formats --------------------------------------------------------------------------------------


def exr_pixels(file: io.BytesIO) -> tuple[NDArray[np.floating[Any]], dict[str, Any]]:
    with tempfile.NamedTemporaryFile(suffix=".exr") as copy:
        copy.write(file.getvalue())
        copy.flush()
        exr = OpenEXR.File(copy.name, separate_channels=True)
        channels = exr.channels()
        letters = "RGB" if set(channels) == set("RGB") else "RGBE"
        planes = [channels[letter].pixels for letter in letters]
        return np.stack(planes, axis=-1), dict(exr.header())


def kinds(formats: str) -> pytest.MarkDecorator:
    """Run a test with every kind of these formats."""
    chosen = [kind for kind in KINDS if kind.format in formats.split()]
    return pytest.mark.parametrize("kind", chosen, ids=str)


# --- pixels --------------------------------------------------------------------------------------


READERS: dict[str, Callable[[io.BytesIO], Any]] = {
    "tif": tifffile.imread,
    "png": lambda file: imagecodecs.png_decode(file.getvalue()),
    "jxl": lambda file: imagecodecs.jpegxl_decode(file.getvalue()),
    "exr": lambda file: exr_pixels(file)[0],
    "dng": lambda file: tifffile.TiffFile(file).pages.first.pages[0].asarray(),
    "npy": np.load,
}
"""Of the samples of files without loss."""


@kinds(" ".join(READERS))
@pytest.mark.parametrize("shape", examples.SIZES)
def test_without_loss_every_sample_comes_back(kind: PictureKind, shape: tuple[int, int]) -> None:
    rgb = scene(shape)
    floating = kind.bits == 32 or kind.format == "exr"
    expected = rgb if kind.space == CAMERA else shown(rgb, kind.space, 6)
    samples = READERS[kind.format](encoded(rgb, kind))
    assert samples.dtype == np.dtype(f"{'float' if floating else 'uint'}{kind.bits}")
    codes = expected.astype(samples.dtype) if floating else quantise(expected, kind.bits)
    assert np.array_equal(samples, codes)


def test_jpeg_keeps_colour_at_full_resolution() -> None:
    rgb = np.zeros((16, 16, 3), np.float32)
    rgb[:, ::2] = 0.5, 0, 0
    rgb[:, 1::2] = 0, 0, 0.7
    read = np.asarray(Image.open(encoded(rgb, PictureKind.of("jpg"), 1))).astype(int)
    difference = np.abs(read - quantise(shown(rgb, "srgb", 1), 8))
    assert difference.max() <= 12  # chroma at half resolution misses by 128


def test_exr_names_the_channels_and_the_shot() -> None:
    rgb = scene((4, 5), 4)
    file = encoded(rgb, PictureKind.of("exr", 32, CAMERA), calibration=FOUR)
    read, header = exr_pixels(file)
    assert np.array_equal(read, rgb)
    assert header["capDate"] == "2014:03:09 07:05:01"
    assert header["comments"] == METADATA.description
    assert (header["expTime"], header["isoSpeed"]) == pytest.approx((1 / 250, 640))
    assert header["Orientation"] == 6
    assert "chromaticities" not in header
    header = exr_pixels(encoded(rgb[..., :3], PictureKind.of("exr")))[1]
    assert "Orientation" not in header
    assert "chromaticities" in header


def test_halves_end_at_their_largest_number_not_at_infinity() -> None:
    bright = np.full((2, 2, 3), 1e9, np.float32)
    read, _ = exr_pixels(encoded(bright, PictureKind.of("exr", 16, CAMERA)))
    assert (read == np.finfo(np.float16).max).all()


def test_a_dng_of_a_method_that_restores_nothing_is_white_where_it_is_saturated() -> None:
    """There its colour is wrong: a raw developer, and the preview inside, showed green clouds and
    yellow lamps.
    """
    calibration = replace(CALIBRATION, neutral=None, camera_to_xyz=None)
    colours = np.array([[(0.6, 1.8, 0.6)], [(1.8, 1.6, -0.4)], [(0.2, 0.3, 0.1)]], np.float32)
    rgb = colours.repeat(30, axis=0).repeat(40, axis=1) * np.float32(calibration.full_scale / 3)
    data = encoded(rgb, PictureKind.of("dng"), 1, calibration=calibration, restored=False)
    with tifffile.TiffFile(data) as tiff:
        main = tiff.pages.first
        shown, codes = main.asarray(), main.pages[0].asarray()
    assert shown[:48].min() >= 250
    assert (codes[:60] == 65535).all()
    assert np.array_equal(codes[60:], quantise(rgb[60:], 16))


# --- what goes along -----------------------------------------------------------------------------


@kinds("tif png jpg uhdr")
def test_the_profile_says_the_colours(kind: PictureKind, tmp_path: Path) -> None:
    """Little CMS reads it. Measurements have none."""
    path, colours = tmp_path / f"a{kind.suffix}", np.random.default_rng(4).random((4, 5, 3))
    rgb = (colours * CALIBRATION.neutral).repeat(16, axis=0).repeat(16, axis=1).astype(np.float32)
    path.write_bytes(encoded(rgb, kind, 1).getvalue())
    scene = load_scene(str(path))
    if kind.space == CAMERA:
        assert scene.camera_to_xyz == SRGB.to_xyz
        return
    space, light = SPACES[kind.space], shown(rgb, kind.space, 1)
    expected = (light if space.linear else decode_srgb(light)) @ space.to_xyz.T
    error = scene.rgb @ np.transpose(scene.camera_to_xyz) - expected
    assert np.abs(error[8::16, 8::16]).max() < (1e-4 if kind.bits > 8 else 0.01)
    assert "profile" not in "".join(scene.notes)
    assert space.title.encode("utf-16-be") in icc_profile(kind.space)


# --- what can be chosen --------------------------------------------------------------------------


def test_what_is_left_open_is_the_first_that_fits() -> None:
    assert PictureKind.of("tif") == PictureKind("tif", 16, "srgb")
    assert PictureKind.of("tif", 32) == PictureKind("tif", 32, "linear-srgb")
    assert PictureKind.of("exr", None, "camera") == PictureKind("exr", 32, "camera")
    with pytest.raises(InputError, match="jpg does not hold any space with 16 bits; it holds srgb"):
        PictureKind.of("jpg", 16)
    with pytest.raises(InputError, match="png does not hold srgb with 32 bits; it holds srgb with"):
        PictureKind.of("png", 32, "srgb")
    with pytest.raises(InputError, match="jpg does not hold camera with any bits; it holds srgb"):
        PictureKind.of("jpg", None, "camera")


@pytest.mark.parametrize(
    ("name", "calibration", "shape", "exposure", "message"),
    [
        ("tif", SensorCalibration(channels="VGBE"), (4, 4), 0.0, "no colour matrix"),
        ("jpg", CALIBRATION, (4, 65501), 0.0, "65501 x 4 pixels: a side of a jpg"),
        ("dng", CALIBRATION, (65501, 4), 0.0, "4 x 65501 pixels: a side of a dng"),
        ("tif", CALIBRATION, (4, 4), 99.0, "exposure is 99.0 stops"),
    ],
)
def test_what_would_fail_after_the_render_is_known_before(
    name: str, calibration: SensorCalibration, shape: tuple[int, int], exposure: float, message: str
) -> None:
    how = development(PictureKind.of(name), shape, calibration=calibration, exposure=exposure)
    with pytest.raises(InputError, match=message):
        FORMATS[name].check(how)
    with pytest.raises(InputError, match=message):
        examples.encode_picture(np.zeros((*shape, len(calibration.channels)), np.float32), how)


def test_no_room_for_openexr_is_an_output_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    how = development(PictureKind.of("exr"), (4, 4))
    with pytest.raises(OutputError, match="no temporary file for OpenEXR"):
        write_picture(tmp_path / "a.exr", [scene((4, 4))], how)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is full")
def test_numpy_files_say_why_they_cannot_be_written() -> None:
    how = development(PictureKind.of("npy"), (40, 50))
    with (
        Path("/dev/full").open("wb", buffering=0) as file,
        pytest.raises(OSError, match="No space") as caught,
    ):
        FORMATS["npy"].encode(file, [scene((40, 50))], how, 1)
    assert caught.value.errno == errno.ENOSPC


# --- Ultra HDR -----------------------------------------------------------------------------------

STEP = 0.03
"""Of a picture's light where it is even: half a code of sRGB at middle grey, half a step of the
map, and what JPEG adds to both.
"""


def highlights() -> FloatArray:
    """Even patches of 16 pixels, from a tenth of display white to four times white: greys above,
    colours below.
    """
    levels = np.geomspace(0.1, 4, 8)
    greys = levels[:, None] * np.array(CALIBRATION.neutral)
    colours = greys * np.array([1.0, 0.7, 0.5])
    patches = np.stack([greys, colours]).astype(np.float32)
    return patches.repeat(16, axis=0).repeat(16, axis=1)


def hdr(data: bytes) -> NDArray[np.float32]:
    """What a display that can show everything shows of a file, 1.0 = display white."""
    halves = imagecodecs.ultrahdr_decode(data, dtype=np.float16)
    return np.asarray(halves[..., :3], np.float32)


@pytest.mark.parametrize("space", ["srgb", "display-p3"])
@pytest.mark.parametrize("shape", examples.SIZES)
def test_the_picture_is_that_of_a_jpeg_and_segments(shape: tuple[int, int], space: str) -> None:
    jpg, uhdr = (PictureKind.of(name, space=space) for name in ("jpg", "uhdr"))
    plain, ultra = (encoded(scene(shape), kind).getvalue() for kind in (jpg, uhdr))
    quantisation = plain.index(b"\xff\xdb")
    assert ultra[:quantisation] == plain[:quantisation]
    assert ultra[ultra.index(b"\xff\xdb") :].startswith(plain[quantisation:])


@pytest.mark.parametrize("space", ["srgb", "display-p3"])
@pytest.mark.parametrize("exposure", [0.0, 1.5, -1.0])
@pytest.mark.parametrize("orientation", [1, 6])
def test_a_display_with_room_shows_the_render(
    space: str, exposure: float, orientation: int
) -> None:
    rgb, kind = highlights(), PictureKind.of("uhdr", space=space)
    data = encoded(rgb, kind, orientation, exposure=exposure).getvalue()
    clipped = ColourTransform.to_space(CALIBRATION, space)
    linear = replace(clipped, space=replace(clipped.space, linear=True))
    result, expected = hdr(data), upright(linear.apply(rgb, exposure), orientation)
    assert result.shape == expected.shape
    result, expected = result[4::16, 4::16], expected[4::16, 4::16]  # inside every patch
    weights = SPACES[space].to_xyz[1]
    np.testing.assert_allclose(result @ weights, expected @ weights, rtol=STEP)
    grey = np.ptp(expected, axis=-1) < 1e-5
    assert expected[grey].max() > 1.5
    np.testing.assert_allclose(result[grey], expected[grey], rtol=STEP)


@pytest.mark.parametrize(
    ("name", "exposure", "shown"),
    [("tif", 0, 1), ("tif", -5, 1), ("dng", 0, 1), ("exr", 0, 1), ("uhdr", 0, 1), ("uhdr", 2, 1.6)],
)
def test_lost_light_is_white_in_every_format_and_in_hdr_no_brighter_than_it_looks(
    name: str, exposure: float, shown: float
) -> None:
    """Magenta, as its clipped samples are, in a linear picture; and a small highlight brighter
    than the sun beside it, in HDR: both have happened.
    """
    plain = replace(CALIBRATION, neutral=(0.8, 1.0, 0.6), camera_to_xyz=None)
    rgb = np.full((48, 64, 3), (0.46, 0.22, 0.28), np.float32)
    lost = np.zeros(rgb.shape[:2], np.uint8)
    lost[16:32, 16:48] = 255
    kind = PictureKind.of(name)
    how = replace(development(kind, rgb.shape[:2], 1), calibration=plain, exposure=exposure)
    written = encode_picture(how.whitened(rgb, lost), how)
    inside = np.s_[20:28, 20:44]
    found: NDArray[Any]
    if name == "uhdr":
        found = hdr(written)[inside]
    elif name == "exr":
        found = exr_pixels(io.BytesIO(written))[0][inside]
    elif name == "dng":
        found = examples.developed(io.BytesIO(written))[inside]
    else:
        found = tifffile.imread(io.BytesIO(written))[inside] / 65535
    assert found == pytest.approx(shown, rel=STEP)


@pytest.mark.parametrize("stops", [0.0, -4.0, -16.0])
def test_light_that_is_partly_lost_grows_white_gradually(stops: float) -> None:
    shown = ColourTransform.to_space(CALIBRATION)
    lost = np.arange(256, dtype=np.uint8)[None]
    rgb = np.full((1, 256, 3), np.float32(0.5) * np.array(shown.white, np.float32))
    picture = shown.apply(shown.whitened(rgb, lost, stops), stops)[0, :, 1]
    assert picture[-1] == pytest.approx(1)
    assert np.diff(picture).min() >= 0
    assert np.diff(picture).max() < 0.1


def test_other_programs_find_both_pictures(tmp_path: Path) -> None:
    path = tmp_path / "picture.jpg"
    path.write_bytes(encoded(highlights(), PictureKind.of("uhdr")).getvalue())
    tags = fields(path, "-a", "-G1", "-XMP:all", "-MPF:all", "-MPImage2", "-warning")
    data = path.read_bytes()
    second = data.index(b"\xff\xd9\xff\xd8") + 2
    assert tags["XMP-hdrgm:Version"] == 1.0
    container = (
        "XMP-GContainer" if "XMP-GContainer:DirectoryItemLength" in tags else "XMP-Container"
    )
    assert tags[f"{container}:DirectoryItemLength"] == len(data) - second  # exiftool 13: G
    assert (tags["MPImage1:MPImageLength"], tags["MPImage2:MPImageStart"]) == (second, second)
    assert tags["MPImage2:MPImageLength"] == len(data) - second
    assert not [key for key in tags if "Warning" in key]
    (tmp_path / "map.jpg").write_bytes(data[second:])
    described = fields(tmp_path / "map.jpg", "-n", "-G1", "-XMP:all", "-warning")
    gains = GainMap(ColourTransform.to_space(CALIBRATION))
    assert described["XMP-hdrgm:GainMapMax"] == pytest.approx(gains.highest, abs=1e-6)
    brightest = 2  # stops above white
    assert described["XMP-hdrgm:HDRCapacityMax"] == pytest.approx(brightest, abs=0.02)
    assert described["XMP-hdrgm:BaseRenditionIsHDR"] in (False, "False")


# --- JPEG XL -------------------------------------------------------------------------------------

LITTLE = 0.012
"""Mean difference at quality 90, relative to white; in other colours than the file says it is 0.05
and more.
"""


def smooth() -> FloatArray:
    """Saturated colours of all hues, beyond those of sRGB too, without noise."""
    down, across = np.mgrid[0:1:80j, 0:1:120j]
    rgb = np.stack([across, 1 - across, down], axis=-1) * np.array(CALIBRATION.neutral)
    return np.asarray(rgb, np.float32)


@kinds("jxl")
def test_with_loss_colours_are_those_that_the_file_names(kind: PictureKind) -> None:
    """The reader makes them from JPEG XL's own, as the codec has labelled them."""
    both = (encoded(smooth(), replace(kind, quality=quality)) for quality in (20, 90))
    worse, good = (file.getvalue() for file in both)
    read = imagecodecs.jpegxl_decode(good)
    assert read.dtype == ("float32" if kind.bits == 32 else f"uint{kind.bits}")
    white = 1 if kind.bits == 32 else 2**kind.bits - 1
    assert np.abs(read / white - shown(smooth(), kind.space, 6)).mean() < LITTLE
    assert len(worse) < len(good)


def test_quality_100_is_without_loss() -> None:
    kinds = (PictureKind("jxl", 8, "srgb", quality) for quality in (None, 100))
    plain, best = (encoded(scene((30, 20)), kind).getvalue() for kind in kinds)
    assert plain == best


# --- writing --------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("orientation", range(1, 9))
def test_upright_is_what_other_programs_show(orientation: int) -> None:
    samples = np.random.default_rng(0).integers(0, 256, (3, 5, 3), np.uint8)
    image = Image.fromarray(samples)
    image.getexif()[274] = orientation
    assert np.array_equal(upright(samples, orientation), np.asarray(ImageOps.exif_transpose(image)))
