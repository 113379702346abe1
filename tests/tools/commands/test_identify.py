"""`panchroma identify`: files of every kind, what is said of their filters, the map of the tile."""

from pathlib import Path
from unittest.mock import patch

import imagecodecs
import numpy as np
import pytest
import tifffile

from panchroma.device.capture.frames import FrameLayout
from panchroma.shared import CfaPattern, SensorCalibration
from panchroma.shared import write_dng as write_shot
from panchroma.tools.capture.identity import identify
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


def test_files_of_every_kind_are_read(tmp_path: Path) -> None:
    small = SONY // 8
    tifffile.imwrite(tmp_path / "a.tif", SONY)
    tifffile.imwrite(tmp_path / "b.tif", small.astype(np.uint8))
    (tmp_path / "c.png").write_bytes(imagecodecs.png_encode(SONY))
    (tmp_path / "d.png").write_bytes(imagecodecs.png_encode(small.astype(np.uint8)))
    np.save(tmp_path / "e.npy", SONY)
    write_dng(tmp_path / "f.dng", SONY, kind=LINEAR_RAW)
    write_dng(tmp_path / "g.dng", SONY)  # which calls itself a Bayer RAW
    sensor = CfaPattern.of_letters("Sony", (3, 2)), SensorCalibration.of_bits(12)
    shot = simulate_additive(SCENE, *sensor, 0.01, np.random.default_rng(0))
    write_shot(tmp_path / "h.dng", shot, preview())
    files = sorted(tmp_path.iterdir())
    outcome = run("identify", "--json", *files, code=0)
    found = {(record["name"], *record["letters"]) for record in outcome.records}
    assert found == {("Sony", *LETTERS)}
    assert [record["source"] for record in outcome.records] == list(map(str, files))
    (other,) = run("identify --json", photograph("raw/rose.dng"), code=0).records
    assert (other["name"], other["letters"][0]) == ("Bayer", "RG")


def test_what_is_said_of_a_tile(tmp_path: Path) -> None:
    """Frames without a known pattern fail with what to do."""
    grey = SCENE.mean(axis=2, keepdims=True).repeat(3, axis=2)
    for name, frame in {
        "bayer": taken(SCENE, tile_of("RG/GB")),
        "flat": np.full((200, 300), 700, np.uint16),
        "grey": taken(grey, tile_of("K=4")),
        "sony": SONY.astype(">u2"),
        "unnamed": taken(SCENE, tile_of("RWWG/WWWW/WBWW/WWWW")),
    }.items():
        np.save(tmp_path / name, frame)
    outcome = run("identify", *sorted(tmp_path.glob("*.npy")), code=1)
    bayer, grey_table, sony, unnamed = outcome.out.split(".npy\n")[1:]
    assert "panchromatic  8 of 16 sites" in sony
    assert "go on         --pattern sony --origin" in sony
    assert "go on         --pattern " in unnamed
    assert "panchromatic  0 of 4 sites" in bayer
    assert "Panchroma cannot use this tile: none of its pixels is panchromatic" in bayer
    unknown = "the colours (?), and perhaps the period, and whether the brightest sites are clear"
    assert f"{unknown}: take a picture" in grey_table
    assert "go on" not in grey_table
    flat, no_name = outcome.errors
    assert "shows no pattern of filters" in flat
    assert "Photograph something with many colours in good light" in flat
    assert "the tile has no name that Panchroma knows; if it is the sensor's own" in no_name


def test_a_tile_that_the_pages_recommend_is_known(tmp_path: Path) -> None:
    """Green is the colour that red and blue both resemble; red and blue stay open."""
    for tile, code in (("RGWW/BWWW/WWWW/WWWW", 0), ("GRWW/BWWW/WWWW/WWWW", 1)):
        np.save(tmp_path / "frame.npy", taken(SCENE, tile_of(tile, (2, 3))))
        (record,) = run("identify --json", tmp_path / "frame.npy", code=code).records
        found = [record["pattern"], *record["alternatives"]]
        both = [[tile, [2, 3]], [tile.translate(str.maketrans("RB", "BR")), [2, 3]]]
        assert found in ([both, both[::-1]] if code else [both])
        assert record["name"] == (None if code else tile)


def test_the_map_shows_how_bright_every_site_is(tmp_path: Path, out: Path) -> None:
    np.save(tmp_path / "sony.npy", SONY)
    (record,) = run("identify", "-o", out, "--json", tmp_path / "sony.npy").records
    assert record["output"] == str(out / "sony-tile.png")
    shown = imagecodecs.png_decode((out / "sony-tile.png").read_bytes())
    cell = shown.shape[0] // 4
    corners = shown[4::cell, 4::cell][:4, :4, 0]
    assert np.corrcoef(corners.ravel(), np.array(record["light"]).ravel())[0, 1] > 0.999
    again = run("identify", "-o", out, tmp_path / "sony.npy")
    assert "exists already; use --overwrite" in again.errors[0]


def test_a_stream_needs_its_layout(tmp_path: Path) -> None:
    path, stride = tmp_path / "frames.bin", 2 * SONY.shape[1] + 16
    layout = f"{SIZE} --pixel-format Y12 --stride {stride}"
    path.write_bytes(pack(SONY, "u16", stride) * 2)
    with path.open("rb") as stream, patch("sys.stdin", stream):
        of_file, of_stream = run("identify --json", path, "-", layout, code=0).records
    assert of_file["letters"] == of_stream["letters"] == list(LETTERS)


@pytest.mark.parametrize(
    ("sent", "padding", "described", "words"),
    [
        ("mono12p", 6, "raw12", "--pixel-format mono12p --stride 330, which shows the tile Sony"),
        ("u16", 0, "u16be", "--pixel-format u16, which shows the tile Sony"),
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
