"""Scenes with other channels than red, green and blue: the same light from every format, and what
is none of it.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from panchroma.shared.errors import InputError
from panchroma.tools.io.scene import Scene
from panchroma.tools.simulation.load import load_scene
from tests.tools.io.files import save

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
    plain = load(tmp_path / "bands.tif", "RGB")
    assert (plain.channels, plain.notes) == ("RGB", ("transparency is left out",))
    assert load(tmp_path / "alpha.tif", "VRNG").channels == "RGB"
    two = save(tmp_path / "two.npy", LIGHT[..., :2])
    assert load(two, "RN").channels == "RN"
    for path in (two, tmp_path / "a.npy"):
        with pytest.raises(InputError, match="leave its transparency out"):
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
