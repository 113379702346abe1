from pathlib import Path

import numpy as np
import pytest

from shared import CfaPattern
from shared.tiles import TILES
from tests.data import ROOT
from tools.evaluation.cameras import CameraPair
from tools.evaluation.measures import Measures
from tools.evaluation.methods import methods
from tools.evaluation.study import can_photograph
from tools.evaluation.tiles import Tile, chosen_tiles, filters_of
from tools.simulation.noise import PaperProtocol, SensorProtocol
from tools.simulation.pattern_text import read_pattern

KODAK = "WBWG/BWGW/WGWR/GWRW"
BROADBAND = CfaPattern.with_block(("CM", "YC"), period=4)


def named(text: str) -> Tile:
    return Tile.named(read_pattern(text), text)


def test_patterns_have_readable_names(tmp_path: Path) -> None:
    path = tmp_path / "mine.txt"
    path.write_text("CMWW\nYCWW\nWWWW\nWWWW\n")
    wide = "/".join(["CMWWWW", "YCWWWW", *["WWWWWW"] * 4])
    texts = (KODAK, str(path), "CMWW/YCWW/WWWW/WWWW", wide, "RGWW/GBWW/WWWW/WWWW", "GRWW/BGWW/WWWW/WWWW")
    assert [named(text).name for text in texts] == [
        "Kodak",
        "mine",
        "CMWW/YCWW/WWWW/WWWW",
        "CMWWWW/... (6 x 6)",
        "K=4",
        "GRWW/BGWW/WWWW/WWWW",
    ]


def test_each_pattern_is_there_once_under_a_name_of_its_own() -> None:
    other = Tile("K=6", CfaPattern.bayer(6, "BGGR"))
    tiles = chosen_tiles([6, 4, 6], [named(KODAK), named("RGWW/GBWW/WWWW/WWWW"), named(KODAK), other])
    assert [tile.name for tile in tiles] == ["K=4", "K=6", "Kodak", "K=6 (2)"]
    assert [tile.period for tile in tiles] == [4, 6, None, None]


def test_share_and_light() -> None:
    """A colour pixel collects a third of the light of a panchromatic one; cyan, magenta and yellow ones two thirds."""
    kodak = named(KODAK)
    assert (kodak.panchromatic_share, kodak.light("RGB")) == (0.5, 2.0)
    assert Tile.of_period(6).light("RGB") == pytest.approx(CfaPattern.bayer(6).light_efficiency)
    assert Tile("", BROADBAND).light("RGB") == pytest.approx((12 * 3 + 4 * 2) / 16)
    assert not can_photograph(Tile("", BROADBAND), "ABC")
    assert can_photograph(None, "RGB")
    assert not can_photograph(None, "RGBN")


def test_under_the_same_light_noise_is_the_same_part_of_white() -> None:
    """White light through cyan, magenta and yellow: everything is halved, and so is the noise."""
    white, dark = np.ones((120, 120, 3), np.float32), np.zeros((120, 120, 3), np.float32)
    for level in (PaperProtocol(0.03), SensorProtocol(0.25)):
        found = []
        for pattern in (CfaPattern.bayer(4), BROADBAND):
            filters = filters_of(pattern, "RGB")
            mask = pattern.panchromatic_mask(white.shape[:2])
            bright, black = (CameraPair(level, 0, light, pattern, None).sparse.signal[mask] for light in (white, dark))
            found.append([each / filters.unit for each in (bright.mean(), bright.std(), black.std())])
        np.testing.assert_allclose(found[1], found[0], rtol=0.01)


@pytest.mark.parametrize("name", ["planes", "best"])
def test_pictures_in_other_colours_are_unmixed_to_the_scenes(name: str) -> None:
    rgb = np.broadcast_to(np.array([0.2, 0.4, 0.3], np.float32), (48, 48, 3))
    for level in (PaperProtocol(0.0), SensorProtocol(0.5)):
        picture = methods()[name].render(CameraPair(level, 0, rgb, BROADBAND, None))
        np.testing.assert_allclose(picture.mean(axis=(0, 1)), rgb[0, 0], atol=0.01)


def test_scenes_of_other_channels_are_measured_by_channel() -> None:
    rng = np.random.default_rng(0)
    truth = rng.random((60, 60, 5)).astype(np.float32)
    rendered = (truth + 0.1 * rng.standard_normal(truth.shape)).astype(np.float32)
    found = Measures.of(rendered, truth, "ABCDE")
    assert found.wrong_hue is None
    assert Measures.decode(found.encode()).wrong_hue is None
    assert found.psnr == pytest.approx((20, 20 + 10 * np.log10(5), 20 - 10 * np.log10(4 / 5)), abs=0.3)
    assert Measures.of(rendered, truth, "GRNBA").wrong_hue is not None


def test_names_that_tables_show_can_be_copied() -> None:
    for name, letters in TILES.items():
        shown = Tile.named(CfaPattern.of_letters(letters), letters).name
        assert CfaPattern.of_letters(shown) == CfaPattern.of_letters(letters)
        assert name == "paper" or f" {name}" in (ROOT / "tools/evaluation/RESULTS.md").read_text("utf-8")
