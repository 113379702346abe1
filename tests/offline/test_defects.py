"""Defective samples: found, listed, replaced; and nothing else touched."""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import BEST, PAPER, render
from panchroma.offline.frame import Frame, Sites
from panchroma.offline.stages.chromaticity import ChromaticitySettings
from panchroma.offline.stages.defects import DefectsSettings, mend_defects
from panchroma.shared import CfaPattern, Mosaic
from panchroma.shared.arrays import BoolArray, FloatArray
from tests.offline.scenes import every_case, photographed, shot

SETTINGS = BEST.defects
LISTED = replace(SETTINGS, contrast=0.0)
FULL = 3.0


def mend(mosaic: Mosaic, settings: DefectsSettings = SETTINGS) -> Mosaic:
    return mend_defects(Frame(mosaic, np.inf), settings).mosaic


def with_hot(mosaic: Mosaic, fraction: float) -> tuple[Mosaic, BoolArray]:
    """The mosaic with a fraction of its pixels at full scale."""
    hot = np.random.default_rng(5).random(mosaic.shape) < fraction
    return replace(mosaic, samples=np.where(hot, np.float32(FULL), mosaic.signal)), hot


def listing(mosaic: Mosaic, places: BoolArray) -> Mosaic:
    defects = tuple((int(row), int(column)) for row, column in np.argwhere(places))
    return replace(mosaic, calibration=replace(mosaic.calibration, defects=defects))


def smooth(shape: tuple[int, int] = (48, 60)) -> FloatArray:
    row, column = np.indices(shape)
    light = 0.5 + 0.2 * np.sin(row / 9) * np.cos(column / 11)
    return (light[..., None] * [0.9, 0.6, 0.3]).astype(np.float32)


def stars() -> FloatArray:
    """Stars as a lens draws them, and lines one pixel wide."""
    row, column = np.indices((60, 60))
    light = np.full((60, 60), 0.02)
    for at in ((9.3, 8.8), (20.0, 31.0), (33.5, 44.5), (45.2, 15.9)):
        light += 0.9 * np.exp(-((row - at[0]) ** 2 + (column - at[1]) ** 2) / (2 * 0.6**2))
    light[50, 5:50] = light[5:55, 55] = 0.9
    np.fill_diagonal(light[25:45, 2:22], 0.9)
    return np.repeat(light[..., None], 3, axis=2).astype(np.float32)


def dots() -> FloatArray:
    """Single pixels, a hundredth of all and more: it is the scene that is so."""
    scene = np.full((60, 60, 3), 0.1, np.float32)
    scene[::4, ::5] = 0.8
    return scene


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.03])
def test_hot_pixels_of_a_smooth_scene_are_all_found_and_nothing_else(sigma: float) -> None:
    sound = photographed(smooth(), sigma=sigma)
    assert mend(sound) is sound
    hurt, hot = with_hot(sound, 0.002)
    changed = mend(hurt).signal != hurt.signal
    inside = np.s_[6:-6, 6:-6]
    assert hot[inside].sum() > 2
    assert np.array_equal(changed[inside], hot[inside])


@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("step", [(0, 2), (2, 2), (2, 0), (1, 2), (2, -2)])
def test_a_second_hot_pixel_nearby_hides_none(step: tuple[int, int], sigma: float) -> None:
    """Each is in the window of the other, and no part of its contrast."""
    sound = photographed(smooth(), sigma=sigma)
    places = [[21, 33], [21 + step[0], 33 + step[1]]]
    assert sound.pattern.panchromatic_mask(sound.shape)[tuple(zip(*places, strict=True))].all()
    samples = sound.signal.copy()
    samples[tuple(zip(*places, strict=True))] = FULL
    changed = np.argwhere(mend(replace(sound, samples=samples)).signal != samples)
    assert sorted(changed.tolist()) == sorted(places)


@pytest.mark.parametrize("value", [FULL, 0.0])
def test_a_bad_colour_sample_tints_nothing(value: float) -> None:
    """Hot or dead, each site of a block, and without the medians' help: the picture is as with
    it.
    """
    row, column = np.indices((48, 60))
    scene = ((0.5 + row / 500 + column / 800)[..., None] * [0.9, 0.6, 0.3]).astype(np.float32)
    sound = photographed(scene)
    alone = ChromaticitySettings(repetitions=0)
    best, paper = (replace(preset, chromaticity=alone) for preset in (BEST, PAPER))
    before = render(sound, best).rgb
    for down, across, _ in sound.pattern.sites:
        samples = sound.signal.copy()
        samples[24 + down, 30 + across] = value
        hurt = replace(sound, samples=samples)
        assert np.abs(render(hurt, paper).rgb - before).max() > 0.03
        assert np.abs(render(hurt, best).rgb - before).max() < 0.01


@every_case
def test_listed_samples_are_never_looked_at(pattern: CfaPattern, shape: tuple[int, int]) -> None:
    """Whatever listed samples read, panchromatic ones and those of whole blocks are replaced by the
    same.
    """
    mosaic = shot(pattern, shape)
    places = np.random.default_rng(1).random(shape) < 0.2
    others = np.random.default_rng(2).uniform(-1, 5, shape).astype(np.float32)
    wild = np.where(places, others, mosaic.signal)
    first, second = (
        mend(listing(replace(mosaic, samples=samples), places), LISTED).signal
        for samples in (mosaic.signal, wild)
    )
    judged = pattern.panchromatic_mask(shape)
    judged[Sites.in_frame(mosaic).pixels] = True
    assert np.array_equal(first[judged], second[judged])
    assert np.array_equal(first[~places], mosaic.signal[~places])
    every = listing(mosaic, np.ones(shape, bool))
    assert np.isfinite(render(every, BEST).rgb).all()


def test_a_listed_sample_on_a_slope_becomes_the_slope() -> None:
    row, column = np.indices((48, 60))
    slope = (0.2 + row / 300 + column / 200).astype(np.float32)
    sound = photographed(slope[..., None].repeat(3, axis=2))
    places = np.zeros(sound.shape, bool)
    places[[10, 21, 21, 40], [11, 33, 34, 5]] = True
    assert np.abs(mend(listing(sound, places), LISTED).signal - sound.signal).max() < 1e-3


def test_along_an_edge_the_edge_goes_on() -> None:
    scene = np.full((48, 60, 3), 0.1, np.float32)
    scene[:, 32:] = 0.5
    sound, places = photographed(scene), np.zeros((48, 60), bool)
    places[[9, 16, 22, 34], [31, 32, 32, 31]] = True
    assert np.abs(mend(listing(sound, places), LISTED).signal - sound.signal).max() < 0.05


def test_a_listed_sample_below_black_is_mended_within_the_range_of_the_others() -> None:
    """There are no ratios to light where there is none."""
    random = np.random.default_rng(0)
    mosaic = photographed(random.uniform(-1, 0.5, (48, 60, 3)).astype(np.float32))
    mended = mend(listing(mosaic, random.random(mosaic.shape) < 0.1), LISTED).signal
    assert np.abs(mended).max() < 2 * np.abs(mosaic.signal).max()


def test_what_is_far_below_black_is_dead_unless_much_of_the_frame_is() -> None:
    for share in (0.01, 0.05):
        mosaic = photographed(smooth(), None, 0.01)
        dead = np.random.default_rng(3).random(mosaic.shape) < share
        samples = np.where(dead, np.float32(-0.2), mosaic.signal)
        found = mend(replace(mosaic, samples=samples)).signal
        wrong = np.abs(found - mosaic.signal)[dead] > 0.15
        assert wrong.any() == (share > 0.03)


def test_most_of_many_hot_pixels_are_mended() -> None:
    hot, places = with_hot(photographed(smooth(), None, 0.01), 0.02)
    assert (mend(hot).signal[places] < FULL).mean() > 0.6


def test_places_outside_the_frame_are_nobodys_and_paper_takes_every_sample_for_good() -> None:
    mosaic = photographed(smooth())
    known = replace(mosaic.calibration, defects=((3, 4000), (4000, 3)))
    outside = replace(mosaic, calibration=known)
    assert mend(outside) is outside
    hurt = listing(*with_hot(mosaic, 0.01))
    assert mend(hurt, PAPER.defects) is hurt


@pytest.mark.parametrize("scene", [stars(), dots()])
def test_small_bright_things_stay(scene: FloatArray) -> None:
    mosaic = photographed(scene)
    assert mend(mosaic) is mosaic


@pytest.mark.parametrize("colour", [(1, 1, 1), (1.6, 0.9, 0.5), (0.6, 0.9, 1.5), (2.6, 0.2, 0.2)])
def test_a_star_on_a_colour_site_stays(colour: tuple[float, ...]) -> None:
    row, column = np.indices((48, 60))
    for down, across, _ in CfaPattern.bayer().sites:
        squares = (row - 24 - down) ** 2 + (column - 30 - across) ** 2
        light = np.exp(-squares / (2 * 0.5**2))[..., None]
        mosaic = photographed((0.02 + 0.5 * light * colour).astype(np.float32))
        assert mend(mosaic) is mosaic


@pytest.mark.parametrize(("around", "thing"), [(0.8, 0.06), (0.1, 0.8)])
@pytest.mark.parametrize("sigma", [0.0, 0.01])
def test_what_a_colour_site_beside_it_sees_as_well_stays(
    around: float, thing: float, sigma: float
) -> None:
    """The dot of a small i, and a star: two pixels, of which one is panchromatic."""
    down, across, _ = CfaPattern.bayer().sites[0]
    row, column = 23 + down, 30 + across  # above a colour site
    scene = np.full((48, 60, 3), around, np.float32)
    scene[row : row + 2, column] = thing
    mosaic = photographed(scene, sigma=sigma)
    assert mend(mosaic) is mosaic
    scene[row + 1, column] = around
    alone = photographed(scene, sigma=sigma)
    assert np.argwhere(mend(alone).signal != alone.signal).tolist() == [[row, column]]
