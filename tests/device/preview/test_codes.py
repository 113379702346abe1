"""Codes as a preview takes them: without the shading that the calibration knows, beyond the edges,
and without the defects that it lists.
"""

from dataclasses import replace

import numpy as np
import pytest

from panchroma.device import Preview
from panchroma.device.preview.codes import without_defects
from panchroma.shared import CfaPattern, FloatArray, Mosaic, SensorCalibration, Shading
from panchroma.tools.simulation.sensor import sample, simulate_additive
from tests.scenes import darker_corners, leaves

SHAPE = (240, 360)
LENS = darker_corners(SHAPE)
PATTERN = CfaPattern.bayer(6)


def shot(bits: int, shading: bool, light: float = 1.0) -> Mosaic:
    calibration = SensorCalibration.of_bits(bits, shading=LENS if shading else None)
    rgb = leaves(*SHAPE) * np.float32(light)
    taken = simulate_additive(rgb, PATTERN, calibration, 0.0, np.random.default_rng(0))
    return Mosaic(taken.codes, PATTERN, taken.calibration)


@pytest.mark.parametrize(("scale", "linear"), [(1, True), (1, False), (3, False)])
def test_a_preview_does_not_show_shading(scale: int, linear: bool) -> None:
    even, undone = (
        Preview.for_mosaic(shot(16, False), scale, linear).run(shot(16, shading))
        for shading in (False, True)
    )
    apart = np.abs(undone.astype(float) - even)
    assert np.quantile(apart, 0.99) <= (0.005 if linear else 2)


@pytest.mark.parametrize("scale", [1, 3])
@pytest.mark.parametrize("headroom", [True, False])
def test_unsaturated_light_keeps_its_colour_at_a_large_gain(scale: int, headroom: bool) -> None:
    calibration = SensorCalibration.of_bits(12, headroom=headroom, shading=LENS)
    # 0.4 of full scale before the gain
    red = np.broadcast_to(np.array((1.1, 0.05, 0.02), np.float32), (*SHAPE, 3))
    gain = LENS.of_plane(SHAPE)[..., None]
    assert gain[0, 0] > 3
    taken = simulate_additive(red * gain, PATTERN, calibration, 0.0, np.random.default_rng(0))
    mosaic = Mosaic(taken.codes, PATTERN, calibration)
    assert mosaic.codes.max() < 0.5 * 4095
    corner = Preview.for_mosaic(mosaic, scale).run(mosaic)[: 20 // scale, : 20 // scale].astype(int)
    assert corner[..., 0].min() > 250
    assert (corner[..., 0] - corner[..., 1:].max(axis=2)).min() > 100


@pytest.mark.parametrize("scale", [1, 3])
def test_what_is_saturated_is_white_wherever_the_gain_is_small_or_large(scale: int) -> None:
    neutral = (0.6, 1.0, 0.7)
    calibration = SensorCalibration.of_bits(12, headroom=False, shading=LENS, neutral=neutral)
    codes = np.full(SHAPE, 4095, np.uint16)
    for _, *lattice in PATTERN.lattices:
        codes[*lattice] = 2000  # panchromatic samples alone are saturated
    assert Preview(PATTERN, scale).run(Mosaic(codes, PATTERN, calibration)).min() == 255


KODAK = CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW")
FOUR = CfaPattern.of_letters("WCWMW/WWCWY/YWWWW/WMWWW/WWYWK")
CROWDED = CfaPattern.of_letters("RG/BW")
CLOSE = 0.05
"""Scene units, of 0.25 to 0.75: what a mended sample may miss in a smooth scene. Unlisted ones miss up
to 5, alone in a block often as little: its samples do not add up to luminance.
"""
FRAME = 60, 66


PLACES = {
    "one red site": [(30, 30)],
    "one panchromatic pixel": [(33, 33)],
    "a block": [(30, 30), (30, 31), (31, 30), (31, 31)],
    "a cluster": [(row, column) for row in range(28, 38) for column in range(29, 39)],
    "a row": [(30, column) for column in range(FRAME[1])],
    "a column": [(row, 31) for row in range(FRAME[0])],
    "the edges": [at for at in np.ndindex(FRAME) if at[0] in (0, 59) or at[1] in (0, 65)],
    "the corners": [(0, 0), (0, 65), (59, 0), (59, 65)],
    "scattered": [*zip(*np.nonzero(np.random.default_rng(1).random(FRAME) < 0.01), strict=True)],
}


def smooth(pattern: CfaPattern) -> FloatArray:
    rows, columns = np.mgrid[: FRAME[0], : FRAME[1]]
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
    [PATTERN, CfaPattern.bayer(3), CfaPattern.bayer(8, "GBRG", (3, 5)), KODAK, FOUR, CROWDED],
    ids=str,
)
def test_listed_defects_do_not_show(pattern: CfaPattern, places: list[tuple[int, int]]) -> None:
    clean, damaged = shots(pattern, places)
    assert furthest(clean, damaged) < CLOSE
    if places is PLACES["a row"]:
        assert furthest(clean, replace(damaged, calibration=clean.calibration)) > 0.15


@pytest.mark.parametrize(("scale", "is_shaded"), [(1, True), (2, False), (3, False), (6, False)])
def test_nor_in_smaller_pictures_and_shaded_shots(scale: int, is_shaded: bool) -> None:
    clean, damaged = shots(PATTERN, PLACES["scattered"])
    if is_shaded:
        shading = Shading((((1.0,) * 4,) * 4,) * 4, FRAME)
        clean, damaged = (
            replace(each, calibration=replace(each.calibration, shading=shading))
            for each in (clean, damaged)
        )
    assert furthest(clean, damaged, scale) < CLOSE * (1 + is_shaded)


def test_a_defect_in_ink_is_not_mended_with_paper() -> None:
    rows, columns = np.mgrid[:60, :60]
    ink = np.abs(rows - columns) < 9
    light = np.where(ink[..., None], np.array([0.5, 0.05, 0.05], np.float32), np.float32(0.8))
    calibration = SensorCalibration.of_bits(12)
    codes = Mosaic(sample(light, PATTERN, calibration), PATTERN, calibration).codes.copy()
    truth = int(codes[30, 30])  # a red site in the middle of the stroke
    codes[30, 30] = 0
    mended = int(without_defects(codes, PATTERN, ((30, 30),))[30, 30])
    assert abs(mended - truth) * calibration.scale()[0] < 0.06


def test_without_defects_in_the_frame_nothing_is_copied() -> None:
    codes = np.full((12, 12), 300, np.uint16)
    assert without_defects(codes, PATTERN, ()) is codes
    assert without_defects(codes, PATTERN, ((12, 0), (0, 99999))) is codes


def test_a_frame_without_a_good_sample_is_shown() -> None:
    every_red = [(row, column) for row in range(0, 60, 6) for column in range(0, 66, 6)]
    for places in ([*np.ndindex(FRAME)], every_red):
        _, damaged = shots(PATTERN, places)
        assert np.isfinite(Preview.for_mosaic(damaged, linear=True).run(damaged)).all()
