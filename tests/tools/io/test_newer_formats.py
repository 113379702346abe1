"""Ultra HDR and JPEG XL, read back by other programs: the samples, in which colours they are, and
the highlights.
"""

from dataclasses import replace
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
from numpy.typing import NDArray

from panchroma.shared.arrays import FloatArray
from panchroma.tools.io.display import SPACES, ColourTransform, upright
from panchroma.tools.io.formats.uhdr import GainMap
from panchroma.tools.io.kind import PictureKind
from tests.exiftool import fields
from tests.tools.io.examples import CALIBRATION, SIZES, encoded, scene, shown
from tests.tools.io.examples import KINDS as ALL_KINDS

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
@pytest.mark.parametrize("shape", SIZES)
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

KINDS = [kind for kind in ALL_KINDS if kind.format == "jxl"]
LITTLE = 0.012
"""Mean difference at quality 90, relative to white; in other colours than the file says it is 0.05
and more.
"""


def smooth() -> FloatArray:
    """Saturated colours of all hues, beyond those of sRGB too, without noise."""
    down, across = np.mgrid[0:1:80j, 0:1:120j]
    rgb = np.stack([across, 1 - across, down], axis=-1) * np.array(CALIBRATION.neutral)
    return np.asarray(rgb, np.float32)


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_with_loss_colours_are_those_that_the_file_names(kind: PictureKind) -> None:
    """The reader makes them from JPEG XL's own, as the codec has labelled them."""
    worse, good = (
        encoded(smooth(), replace(kind, quality=quality)).getvalue() for quality in (20, 90)
    )
    read = imagecodecs.jpegxl_decode(good)
    assert read.dtype == ("float32" if kind.bits == 32 else f"uint{kind.bits}")
    white = 1 if kind.bits == 32 else 2**kind.bits - 1
    assert np.abs(read / white - shown(smooth(), kind.space, 6)).mean() < LITTLE
    assert len(worse) < len(good)


def test_quality_100_is_without_loss() -> None:
    kinds = (PictureKind("jxl", 8, "srgb", quality) for quality in (None, 100))
    plain, best = (encoded(scene((30, 20)), kind).getvalue() for kind in kinds)
    assert plain == best
