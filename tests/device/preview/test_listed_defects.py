from dataclasses import replace

import numpy as np
import pytest

from panchroma.device import Preview
from panchroma.device.preview.listed_defects import without_defects
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration, Shading
from panchroma.shared.arrays import FloatArray
from panchroma.tools.simulation.sensor import sample

SIX = CfaPattern.bayer(6)
KODAK = CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW")
FOUR = CfaPattern.of_letters("WCWMW/WWCWY/YWWWW/WMWWW/WWYWK")
CROWDED = CfaPattern.of_letters("RG/BW")
CLOSE = 0.05
"""Scene units, of 0.25 to 0.75: what a mended sample may miss in a smooth scene. An unlisted one
misses 0.5 to 8.
"""
SHAPE = 60, 66


PLACES = {
    "one red site": [(30, 30)],
    "one panchromatic pixel": [(33, 33)],
    "a block": [(30, 30), (30, 31), (31, 30), (31, 31)],
    "a cluster": [(row, column) for row in range(28, 38) for column in range(29, 39)],
    "a row": [(30, column) for column in range(SHAPE[1])],
    "a column": [(row, 31) for row in range(SHAPE[0])],
    "the edges": [at for at in np.ndindex(SHAPE) if at[0] in (0, 59) or at[1] in (0, 65)],
    "the corners": [(0, 0), (0, 65), (59, 0), (59, 65)],
    "scattered": [*zip(*np.nonzero(np.random.default_rng(1).random(SHAPE) < 0.01), strict=True)],
}


def smooth(pattern: CfaPattern) -> FloatArray:
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    tint = np.linspace(1, 0.3, len(pattern.channels))
    light = 0.25 + 0.1 * np.sin(rows / 20)[..., None] + 0.1 * np.cos(columns / 17)[..., None] * tint
    return light.astype(np.float32)


def shots(pattern: CfaPattern, places: list[tuple[int, int]]) -> tuple[Mosaic, Mosaic]:
    """A shot, and the same with hot and dead pixels that its calibration lists."""
    calibration = SensorCalibration.of_bits(12, channels=pattern.channels)
    clean = Mosaic(sample(smooth(pattern), pattern, calibration), pattern, calibration)
    codes = clean.codes.copy()
    for number, place in enumerate(places):
        codes[place] = 0 if number % 2 else 4095
    return clean, Mosaic(codes, pattern, replace(calibration, defects=tuple(places)))


def furthest(one: Mosaic, other: Mosaic, scale: int = 1) -> float:
    preview = Preview.for_mosaic(one, scale, linear=True, threads=1)
    return float(np.abs(preview.run(one) - preview.run(other)).max())


@pytest.mark.parametrize("places", PLACES.values(), ids=list(PLACES))
@pytest.mark.parametrize(
    "pattern",
    [SIX, CfaPattern.bayer(3), CfaPattern.bayer(8, "GBRG", (3, 5)), KODAK, FOUR, CROWDED],
    ids=str,
)
def test_listed_defects_do_not_show(pattern: CfaPattern, places: list[tuple[int, int]]) -> None:
    clean, damaged = shots(pattern, places)
    assert furthest(clean, damaged) < CLOSE
    if places is PLACES["a block"]:
        assert furthest(clean, replace(damaged, calibration=clean.calibration)) > 0.15


@pytest.mark.parametrize("scale", [2, 3, 6])
def test_nor_in_smaller_pictures(scale: int) -> None:
    assert furthest(*shots(SIX, PLACES["scattered"]), scale) < CLOSE


def test_a_defect_in_ink_is_not_mended_with_paper() -> None:
    rows, columns = np.mgrid[:60, :60]
    ink = np.abs(rows - columns) < 9
    light = np.where(ink[..., None], np.array([0.5, 0.05, 0.05], np.float32), np.float32(0.8))
    calibration = SensorCalibration.of_bits(12)
    codes = Mosaic(sample(light, SIX, calibration), SIX, calibration).codes.copy()
    truth = int(codes[30, 30])  # a red site in the middle of the stroke
    codes[30, 30] = 0
    mended = int(without_defects(codes, SIX, ((30, 30),))[30, 30])
    assert abs(mended - truth) * calibration.scale()[0] < 0.06


def test_without_defects_in_the_frame_nothing_is_copied() -> None:
    codes = np.full((12, 12), 300, np.uint16)
    assert without_defects(codes, SIX, ()) is codes
    assert without_defects(codes, SIX, ((12, 0), (0, 99999))) is codes


def test_a_frame_without_a_good_sample_is_shown() -> None:
    clean, damaged = shots(SIX, [*np.ndindex(SHAPE)])
    assert np.isfinite(Preview.for_mosaic(clean, linear=True).run(damaged)).all()
    every_red = [(row, column) for row in range(0, 60, 6) for column in range(0, 66, 6)]
    assert np.isfinite(Preview.for_mosaic(clean, linear=True).run(shots(SIX, every_red)[1])).all()


def test_defects_in_a_shaded_shot() -> None:
    shading = Shading((((1.0,) * 4,) * 4,) * 4, SHAPE)
    clean, damaged = (
        replace(each, calibration=replace(each.calibration, shading=shading))
        for each in shots(SIX, PLACES["scattered"])
    )
    assert furthest(clean, damaged) < 2 * CLOSE
