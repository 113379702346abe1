"""The scenes of an evaluation: which may be pooled, how they are cut and named; and patterns before
them under the same light.
"""

from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image

from panchroma.shared import CfaPattern, InputError
from panchroma.tools.evaluation.cameras import CameraPair, Tile, filters_of
from panchroma.tools.evaluation.methods import methods
from panchroma.tools.evaluation.scene_sets import BUILTIN, DEVELOPED, MEASURED, Reading, distinct
from panchroma.tools.simulation.load import load_scene
from panchroma.tools.simulation.pattern_text import read_pattern
from panchroma.tools.simulation.protocols import PaperProtocol, SensorProtocol

# --- scene sets -----------------------------------------------------------------------------------

RNG = np.random.default_rng(0)


def write_png16(path: Path, codes: np.ndarray) -> None:
    path.write_bytes(imagecodecs.png_encode(codes.astype(np.uint16)))


def test_pictures_are_told_from_measurements(tmp_path: Path) -> None:
    codes = RNG.integers(0, 65536, (60, 60, 3), dtype=np.uint16)
    names = {"kodim07.png": "Kodak", "mcm03.png": "McMaster"}
    names |= dict.fromkeys(("holiday.png", "holiday.jpg", "18.tif"), DEVELOPED)
    for name in names:
        Image.fromarray((codes >> 8).astype(np.uint8)).save(tmp_path / name)
    tifffile.imwrite(tmp_path / "17.tif", codes)
    write_png16(tmp_path / "kodim08.png", codes)
    np.save(tmp_path / "light.npy", RNG.random((60, 60, 3)).astype(np.float32))
    names |= dict.fromkeys(("17.tif", "kodim08.png", "light.npy"), MEASURED)
    for name, group in names.items():
        assert Reading().info(str(tmp_path / name)).group == group, name
    for source in ("builtin:90x60", "chart:240x180"):
        assert Reading().info(source).group == BUILTIN
    assert Reading(linear=True).info(str(tmp_path / "kodim07.png")).group == MEASURED


def test_scenes_are_cut_and_small_ones_refused(tmp_path: Path) -> None:
    path = str(tmp_path / "scene.npy")
    np.save(path, RNG.random((61, 80, 3)).astype(np.float32))
    info = Reading().info(path)
    assert Reading().scene(info).rgb.shape == (info.rows, info.columns, 3) == (60, 78, 3)
    assert Reading(largest=50).info(path).rows == 48
    np.save(path, RNG.random((41, 80, 3)).astype(np.float32))
    with pytest.raises(InputError, match="78 x 36 pixels are left, too few"):
        Reading().info(path)


def test_each_scene_is_measured_once_under_a_name_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    pixels = RNG.random((48, 48, 3)).astype(np.float32)
    np.save(tmp_path / "scene.npy", pixels)
    np.save(tmp_path / "copy.npy", pixels)
    np.save(tmp_path / "a" / "scene.npy", pixels / 2)
    sources = [str(tmp_path / name) for name in ("scene.npy", "copy.npy", "a/scene.npy")]
    scenes, remarks = distinct([Reading().info(source) for source in sources])
    assert [scene.name for scene in scenes] == ["scene", "scene (2)"]
    assert len(remarks) == 1
    assert "copy.npy: has the same pixels" in remarks[0]


def test_white_is_estimated_where_a_measurement_does_not_say_it(tmp_path: Path) -> None:
    rgb = RNG.random((60, 60, 1)) * np.array([0.5, 1.0, 0.25])
    np.save(tmp_path / "green.npy", rgb.astype(np.float32))
    neutral = Reading().info(str(tmp_path / "green.npy")).neutral
    assert neutral == pytest.approx((0.5, 1.0, 0.25), rel=0.1)
    assert Reading().info("builtin:90x60").neutral == (1.0, 1.0, 1.0)


def test_gehlers_set_is_recognised_and_no_other_picture_taken_for_it(tmp_path: Path) -> None:
    codes = RNG.integers(200, 3700, (50, 60, 3))
    pictures = [
        ("IMG_0277", codes, 129, 4095, "Canon 5D"),
        ("8D5U5524", codes, 0, 4095, "Canon 1D"),
        ("IMG_0278", codes * 16, 0, 65535, ""),
        ("IMG_277", codes, 0, 65535, ""),
        ("8D5U5525", codes[..., :1], 0, 65535, ""),
    ]
    for name, pixels, black, white, camera in pictures:
        write_png16(tmp_path / f"{name}.png", pixels)
        scene = load_scene(str(tmp_path / f"{name}.png"))
        expected = (pixels[..., 0] - black) / (white - black)
        np.testing.assert_allclose(scene.rgb[..., 0], expected, atol=1e-6)
        assert (f"black level {black}" in " ".join(scene.notes)) == bool(camera)
        assert camera in " ".join(scene.notes)


# --- tiles ----------------------------------------------------------------------------------------

KODAK = "WBWG/BWGW/WGWR/GWRW"
BROADBAND = CfaPattern.with_block(("CM", "YC"), period=4)


def named(text: str) -> Tile:
    return Tile.named(read_pattern(text), text)


def test_patterns_have_readable_names(tmp_path: Path) -> None:
    path = tmp_path / "mine.txt"
    path.write_text("CMWW\nYCWW\nWWWW\nWWWW\n")
    texts = (KODAK, str(path), "CMWW/YCWW/WWWW/WWWW", "RGWW/GBWW/WWWW/WWWW", "GRWW/BGWW/WWWW/WWWW")
    tiles = [named(text) for text in texts]
    assert [tile.name for tile in tiles] == ["Kodak", "mine", texts[2], "K=4", texts[4]]
    assert [tile.period for tile in tiles] == [None, None, None, 4, None]


def test_share_and_light() -> None:
    """A colour pixel collects a third of the light of a panchromatic one; cyan, magenta and yellow
    ones two thirds.
    """
    bayer = CfaPattern.bayer(6)
    assert Tile.named(bayer).light == pytest.approx(bayer.light_efficiency())
    assert Tile("", BROADBAND).light == pytest.approx((12 * 3 + 4 * 2) / 16)
    five = named("VRGWWW/NUGWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW")
    # a site of five lets a fifth of the light through
    assert five.light == pytest.approx((30 * 3 + 6 * 3 / 5) / 36)
    with pytest.raises(InputError, match="positive weights"):
        named("RYWW/WBWW/WWWW/WWWW")


def test_under_the_same_light_noise_is_the_same_part_of_white() -> None:
    """White light through cyan, magenta and yellow: everything is halved, and so is the noise."""
    white, dark = np.ones((120, 120, 3), np.float32), np.zeros((120, 120, 3), np.float32)
    for level in (PaperProtocol(0.03), SensorProtocol(0.25)):
        moments = []
        for pattern in (CfaPattern.bayer(4), BROADBAND):
            mask = pattern.panchromatic_mask(white.shape[:2])
            shots = [CameraPair(level, 0, light, pattern, None).sparse for light in (white, dark)]
            bright, black = (shot.signal[mask] for shot in shots)
            values = np.array((bright.mean(), bright.std(), black.std()))
            moments.append(values / filters_of(pattern).unit)
        np.testing.assert_allclose(moments[1], moments[0], rtol=0.01)


def test_pictures_in_other_colours_are_unmixed_to_the_scenes() -> None:
    rgb = np.broadcast_to(np.array([0.2, 0.4, 0.3], np.float32), (48, 48, 3))
    for level in (PaperProtocol(0.0), SensorProtocol(0.5)):
        picture = methods()["best"].render(CameraPair(level, 0, rgb, BROADBAND, None))
        np.testing.assert_allclose(picture.mean(axis=(0, 1)), rgb[0, 0], atol=0.01)
