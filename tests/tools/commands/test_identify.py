"""`panchroma identify`: files of every kind, what is said of their filters, the map of the tile."""

from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import imagecodecs
import numpy as np
import pytest
import tifffile

from panchroma.device.capture.frames import FrameLayout
from panchroma.shared import CfaPattern, SensorCalibration
from panchroma.shared import write_dng as write_shot
from panchroma.shared.arrays import CodeArray
from panchroma.tools.capture.identity import identify
from panchroma.tools.simulation.pattern_text import read_pattern
from panchroma.tools.simulation.sensor import simulate_additive
from tests.data import photograph
from tests.device.packer import pack
from tests.shared.dng.examples import preview
from tests.tools.capture.test_identity import SCENE, taken, tile_of
from tests.tools.command import run
from tests.tools.io.files import LINEAR_RAW, write_dng

SONY = taken(SCENE, tile_of("Sony", (3, 2)))
SIZE = f"--size {SONY.shape[1]}x{SONY.shape[0]}"
LETTERS = identify(SONY).tile


def padded(frame: CodeArray, padding: int) -> bytes:
    return np.pad(frame, ((0, 0), (0, padding))).astype("<u2").tobytes()


def test_files_of_every_kind_are_read(tmp_path: Path) -> None:
    small = SONY // 8
    tifffile.imwrite(tmp_path / "a.tif", SONY)
    tifffile.imwrite(tmp_path / "b.tif", small.astype(np.uint8))
    (tmp_path / "c.png").write_bytes(imagecodecs.png_encode(SONY))
    (tmp_path / "d.png").write_bytes(imagecodecs.png_encode(small.astype(np.uint8)))
    np.save(tmp_path / "e.npy", SONY)
    write_dng(tmp_path / "f.dng", SONY, kind=LINEAR_RAW)
    write_dng(tmp_path / "g.dng", SONY)  # which calls itself a Bayer RAW
    files = sorted(tmp_path.iterdir())
    outcome = run("identify", "--json", *files, code=0)
    assert {(record["name"], tuple(record["letters"])) for record in outcome.records} == {
        ("Sony", LETTERS)
    }
    assert [record["source"] for record in outcome.records] == list(map(str, files))


@pytest.mark.parametrize("name", ["Sony", "Kaizu", "paper", "RWWG/WWWW/WBWW/WWWW"])
def test_one_of_the_lines_to_go_on_with_describes_the_sensor(tmp_path: Path, name: str) -> None:
    """Several, where colours with equally many sites may be exchanged."""
    tile = tile_of(name, (1, 2))
    np.save(tmp_path / "a.npy", taken(SCENE, tile))
    (record,) = run("identify", "--json", tmp_path / "a.npy").records
    described = [
        replace(read_pattern(letters), origin=tuple(origin)).letters_from()
        for letters, origin in (record["pattern"], *record["alternatives"])
    ]
    assert len({*described}) == len(described)
    assert tile in described
    assert described[0] == tuple(record["letters"])


def test_what_is_said_of_a_tile(tmp_path: Path) -> None:
    np.save(tmp_path / "sony.npy", SONY)
    np.save(tmp_path / "bayer.npy", taken(SCENE, tile_of("RG/GB")))
    grey_scene = SCENE.mean(axis=2, keepdims=True).repeat(3, axis=2)
    np.save(tmp_path / "grey.npy", taken(grey_scene, tile_of("K=4")))
    told = run("identify", *sorted(tmp_path.glob("*.npy")), code=0).out
    bayer, grey, sony = told.split(".npy\n")[1:]
    assert "panchromatic  8 of 16 sites" in sony
    assert "go on         --pattern sony --origin" in sony
    assert "panchromatic  0 of 4 sites" in bayer
    assert "Panchroma cannot use this tile: none of its pixels is panchromatic" in bayer
    unknown = "the colours (?), and perhaps the period, and whether the brightest sites are clear"
    assert f"{unknown}: take a picture" in grey
    assert "go on" not in grey


def test_the_map_shows_how_bright_every_site_is(tmp_path: Path, out: Path) -> None:
    np.save(tmp_path / "sony.npy", SONY)
    (record,) = run("identify", "-o", out, "--json", tmp_path / "sony.npy").records
    assert record["output"] == str(out / "sony-tile.png")
    shown = imagecodecs.png_decode((out / "sony-tile.png").read_bytes())
    cell = shown.shape[0] // 4
    corners = shown[4::cell, 4::cell][:4, :4].astype(int)
    assert (corners == corners[..., :1]).all()  # grey
    light = np.array(record["light"])
    assert np.corrcoef(corners[..., 0].ravel(), light.ravel())[0, 1] > 0.999
    middles = shown[cell // 5 + cell // 2 :: cell, cell // 2 :: cell]  # below the letters
    for letter, strongest in zip("RGB", range(3), strict=True):
        sites = np.array([[*row] for row in record["letters"]]) == letter
        assert (middles[:4, :4][sites].argmax(axis=-1) == strongest).all()
    again = run("identify", "-o", out, tmp_path / "sony.npy")
    assert "exists already; use `overwrite=True`" in again.errors[0]


def test_frames_without_a_known_pattern_fail_with_what_to_do(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.full((200, 300), 700, np.uint16))
    np.save(tmp_path / "b.npy", SONY)
    np.save(tmp_path / "c.npy", taken(SCENE, tile_of("RWWG/WWWW/WBWW/WWWW")))
    outcome = run("identify", *sorted(tmp_path.glob("*.npy")), code=1)
    flat, unnamed = outcome.errors
    assert "shows no pattern of filters" in flat
    assert "Photograph something with many colours in good light" in flat
    assert "the tile has no name that Panchroma knows; if it is the sensor's own" in unnamed
    assert outcome.out.count("go on         --pattern ") == 2


def test_a_shot_and_raws_of_other_cameras_are_read(tmp_path: Path) -> None:
    sensor = CfaPattern.of_letters("kodak", (1, 2)), SensorCalibration.of_bits(12)
    shot = simulate_additive(SCENE, *sensor, 0.01, np.random.default_rng(0))
    write_shot(tmp_path / "shot.dng", shot, preview())
    paths = tmp_path / "shot.dng", photograph("raw/rose.dng")
    ours, other = run("identify --json", *paths, code=0).records
    assert (ours["name"], other["name"], other["letters"][0]) == ("Kodak", "Bayer", "RG")


def test_a_stream_needs_its_layout(tmp_path: Path) -> None:
    path, layout = tmp_path / "frames.bin", f"{SIZE} --pixel-format Y12"
    stride = f"--stride {2 * SONY.shape[1] + 16}"
    path.write_bytes(padded(SONY, 8) * 2)
    with path.open("rb") as stream, patch("sys.stdin", stream):
        of_file, of_stream = run("identify --json", path, "-", layout, stride, code=0).records
    assert of_file["letters"] == of_stream["letters"] == list(LETTERS)


@pytest.mark.parametrize(
    ("sent", "padding", "described", "words"),
    [
        ("mono12p", 6, "raw12", "`pixel_format=mono12p` `stride=330`, which shows the tile Sony"),
        ("u16", 0, "u16be", "`pixel_format=u16`, which shows the tile Sony"),
    ],
)
def test_another_packing_or_stride_is_named_and_fails(
    tmp_path: Path, sent: str, padding: int, described: str, words: str
) -> None:
    """The first-frame check tells them, too; a wrong layout does not pass as a tile without a
    name.
    """
    stride = FrameLayout(SONY.shape[1], 1, sent).stride + padding
    (tmp_path / "frames.bin").write_bytes(pack(SONY, sent, stride) * 2)
    options = f"{SIZE} --pixel-format {described}"
    assert words in run("identify", tmp_path / "frames.bin", options, code=1).errors[0]
