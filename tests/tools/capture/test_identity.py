"""The tile of every sensor is found where it is, and frames that prove nothing show none."""

from functools import cache
from typing import Any

import imagecodecs
import numpy as np
import pytest

from panchroma.shared import CfaPattern, CodeArray, FloatArray
from panchroma.shared.tiles import CLEAR, TILES, letters_of
from panchroma.tools.capture.identity import COMPARED, DENSE, UNKNOWN, describe, facts_of, identify
from panchroma.tools.simulation.load import load_scene
from tests.data import photograph
from tests.scenes import leaves

SCENE = leaves(160, 216)
LARGE = leaves(256, 320)
SPARSE = "RWWGWW/WWWWWW/WWWWWW/GWWBWW/WWWWWW/WWWWWW"


def tile_of(letters: str, origin: tuple[int, int] = (0, 0)) -> tuple[str, ...]:
    """The letters from the first pixel on of a tile that begins at `origin`."""
    rows = np.array([[*row] for row in (letters_of(letters) or letters).split("/")])
    return tuple("".join(row) for row in np.roll(rows, origin, (0, 1)).tolist())


def taken(
    scene: FloatArray, tile: tuple[str, ...], sigma: float = 0.01, channels: str = "RGB"
) -> CodeArray:
    """A scene through the filters of a tile; panchromatic pixels read the sum of the channels, as
    in the paper.
    """
    planes = np.concatenate([scene, scene.sum(axis=2, keepdims=True)], axis=2)
    size, period = scene.shape[:2], len(tile)
    which = np.array([[(channels + "W").index(letter) for letter in row] for row in tile])
    places = np.ix_(*(np.arange(side) % period for side in size))
    light = np.take_along_axis(planes, which[places][..., None], axis=2)[..., 0]
    noise = np.random.default_rng(0).normal(0, sigma, size)
    return np.asarray(256 + 1000 * (light + noise)).clip(0, 4095).astype(np.uint16)


def same_sites(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    """Whether the same sites of two tiles are alike, and the same ones panchromatic."""
    first, second = ("".join(tile) for tile in (one, other))
    exchanged = dict(zip(first, second, strict=False))
    same = "".join(exchanged.get(letter, "") for letter in first) == second
    return same and exchanged.get("W", "W") == "W"


def fitting(facts: dict[str, Any]) -> list[tuple[str, ...]]:
    """The tiles of the patterns that one may go on with: several, where colours with equally many
    sites may be exchanged.
    """
    described = [facts["pattern"], *facts["alternatives"]]
    return [CfaPattern.of_letters(*each).letters_from() for each in described]


def opened(tile: tuple[str, ...]) -> tuple[str, ...]:
    """The tile with all its colours open."""
    return tuple(row.translate(str.maketrans("RGB", UNKNOWN * 3)) for row in tile)


@cache
def picture(name: str) -> FloatArray:
    return np.asarray(imagecodecs.png_decode(photograph(name).read_bytes()) / 65535, np.float32)


@pytest.mark.parametrize(
    ("name", "letters", "channels"),
    [
        *((name, name, "RGB") for name in TILES if name not in CLEAR),
        *((f"K={period}", f"K={period}", "RGB") for period in (3, 4, 5, *range(7, 17))),
        *(
            (f"K={period}", "/".join(CfaPattern.bayer(period, "GRBG").tile), "RGB")
            for period in (3, 4, 5, *range(7, 17))
        ),
        *((name, letters, "RGB") for name, letters in DENSE.items()),
        *((letters, letters, "RGB") for letters in COMPARED if "V" not in letters),
        *((letters, letters, "VRGNU") for letters in COMPARED if "V" in letters),
        *(("", letters, "RGB") for letters in (SPARSE, "RWWG/WWWW/WBWW/WWWW")),
        ("", "CMWWW/CYWWW/YWWWW/WWWWW/WWWWW", "CMY"),
    ],
)
def test_every_tile_is_found_wherever_it_begins(name: str, letters: str, channels: str) -> None:
    """Those without panchromatic pixels have no pattern; those without a name show which sites are
    alike.
    """
    period = len(tile_of(letters))
    rows = range(period) if period <= 6 else (1, period - 2)
    for origin in ((row, (3 * row + 1) % period) for row in rows) if name else [(2, 3)]:
        tile = tile_of(letters, origin)
        scene = SCENE if name and period <= 6 and channels == "RGB" else LARGE
        scene = np.concatenate([scene, scene[::-1, :, : len(channels) - 3]], axis=2)
        facts = facts_of(taken(scene, tile, channels=channels))
        assert (facts["name"] or "") == name, origin
        assert same_sites(tuple(facts["letters"]), tile), origin
        assert np.shape(facts["light"]) == (period, period)
        if channels == "RGB" and name not in DENSE:
            assert tile in fitting(facts)


@pytest.mark.parametrize("name", CLEAR)
@pytest.mark.parametrize("origin", [(0, 0), (0, 1), (1, 1)])
def test_clear_sites_are_told_from_green_ones(name: str, origin: tuple[int, int]) -> None:
    tile = CfaPattern.of_letters(name, origin).letters_from()
    facts = facts_of(taken(picture("linear/intel_tau_001.png"), tile))
    assert facts["name"] == ("RCCC" if name == "RCCC" else "RCCB")
    assert tile in fitting(facts)


def test_green_sites_that_are_brighter_than_others_are_not_clear() -> None:
    """Red reads more than green in some places: in daylight green is the strongest channel, and
    changes as much as clear sites do.
    """
    daylight = np.array([0.5, 1.0, 0.6], np.float32)
    scene = load_scene(str(photograph("kodak/kodim05.png"))).rgb * daylight
    assert identify(taken(scene, ("RG", "GB"), 0.003)).name == "Bayer"


@pytest.mark.parametrize("letters", ["BGRG/GEGE/RGBG/GEGE", "GRGB/RGBG/GBGR/BGRG"])
def test_bright_sites_of_different_filters_are_not_taken_for_panchromatic(letters: str) -> None:
    infrared = np.concatenate([LARGE, LARGE.mean(axis=2, keepdims=True)], axis=2)
    tile = tile_of(letters, (1, 2))
    assert {*"".join(identify(taken(infrared, tile, channels="RGBE")).tile)} == {UNKNOWN}


@pytest.mark.parametrize("letters", ["CY/GM", "GMGM/CYCY/MGMG/CYCY"])
@pytest.mark.parametrize("name", ["", "linear/intel_tau_001.png", "linear/intel_tau_015.png"])
def test_four_dense_colours_are_taken_for_no_other_tile(letters: str, name: str) -> None:
    """Yellow sites are alike and the brightest, but they do not see the sum of the others."""
    red, green, blue = np.moveaxis(picture(name) if name else LARGE, 2, 0)
    scene = np.stack([green + blue, red + blue, red + green, green], axis=2)
    identity = identify(taken(scene, tile_of(letters), channels="CMYG"))
    assert identity.name == ""
    assert {*"".join(identity.tile)} <= {"W", UNKNOWN}


@pytest.mark.parametrize(
    ("name", "sigma"), [("linear/intel_tau_003.png", 0.01), ("linear/intel_tau_012.png", 0.03)]
)
def test_in_noisy_photographs_nothing_wrong_is_found(name: str, sigma: float) -> None:
    """What they do not show is left open: colours of the largest tiles."""
    for known in [*(TILES.keys() - CLEAR), "K=3", "K=8", "K=16", *DENSE.values()]:
        tile = tile_of(known, (3, 1))
        identity = identify(taken(picture(name), tile, sigma))
        assert same_sites(identity.tile, tile) or identity.tile == opened(tile)
        assert len(tile) > 6 or UNKNOWN not in "".join(identity.tile)


def test_the_colours_of_a_grey_scene_stay_open_and_pale_ones_are_found() -> None:
    grey = SCENE.mean(axis=2, keepdims=True).repeat(3, axis=2)
    pale = taken(grey + 0.1 * (SCENE - grey), tile_of("Kodak", (1, 2)), 0.003)
    assert identify(pale).name == "Kodak"
    identity = identify(taken(grey, tile_of("paper", (1, 4))))
    assert identity.tile == opened(tile_of("paper", (1, 4)))
    assert describe(identity.tile) is None


GREY = (256 + 3000 * SCENE.mean(axis=2)).astype(np.uint16)
NOTHING = {
    "flat": np.full((200, 300), 512, np.uint16),
    "ramp": np.add.outer(np.arange(200), np.arange(300)).astype(np.uint16),
    "a monochrome sensor": GREY,
    "a dark frame": np.random.default_rng(0).integers(255, 258, (200, 300)).astype(np.uint16),
    "a small part": taken(SCENE, tile_of("Kodak"))[:40, :40],
    "a line": taken(SCENE, tile_of("Kodak"))[:1],
    "a pixel": np.ones((1, 1), np.uint16),
}


@pytest.mark.parametrize("kind", NOTHING)
def test_frames_that_prove_nothing_show_nothing(kind: str) -> None:
    assert identify(NOTHING[kind]) is None
