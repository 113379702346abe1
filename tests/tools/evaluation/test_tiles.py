from pathlib import Path

import numpy as np
import pytest

from panchroma.shared import CfaPattern
from panchroma.shared.errors import InputError
from panchroma.tools.evaluation.cameras import CameraPair, Tile, filters_of
from panchroma.tools.evaluation.methods import methods
from panchroma.tools.simulation.pattern_text import read_pattern
from panchroma.tools.simulation.protocols import PaperProtocol, SensorProtocol

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
    kodak = named(KODAK)
    assert kodak.light == 2
    assert Tile.of_period(6).light == pytest.approx(CfaPattern.bayer(6).light_efficiency())
    assert Tile("", BROADBAND).light == pytest.approx((12 * 3 + 4 * 2) / 16)
    assert named("VRGWWW/NUGWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW").light == pytest.approx(
        (30 * 3 + 6 * 3 / 5) / 36  # a site of five lets a fifth of the light through
    )
    with pytest.raises(InputError, match="positive weights"):
        named("RYWW/WBWW/WWWW/WWWW")


def test_under_the_same_light_noise_is_the_same_part_of_white() -> None:
    """White light through cyan, magenta and yellow: everything is halved, and so is the noise."""
    white, dark = np.ones((120, 120, 3), np.float32), np.zeros((120, 120, 3), np.float32)
    for level in (PaperProtocol(0.03), SensorProtocol(0.25)):
        moments = []
        for pattern in (CfaPattern.bayer(4), BROADBAND):
            mask = pattern.panchromatic_mask(white.shape[:2])
            bright, black = (
                CameraPair(level, 0, light, pattern, None).sparse.signal[mask]
                for light in (white, dark)
            )
            values = np.array((bright.mean(), bright.std(), black.std()))
            moments.append(values / filters_of(pattern).unit)
        np.testing.assert_allclose(moments[1], moments[0], rtol=0.01)


def test_pictures_in_other_colours_are_unmixed_to_the_scenes() -> None:
    rgb = np.broadcast_to(np.array([0.2, 0.4, 0.3], np.float32), (48, 48, 3))
    for level in (PaperProtocol(0.0), SensorProtocol(0.5)):
        picture = methods()["best"].render(CameraPair(level, 0, rgb, BROADBAND, None))
        np.testing.assert_allclose(picture.mean(axis=(0, 1)), rgb[0, 0], atol=0.01)
