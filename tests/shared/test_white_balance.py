"""The white balance: estimated from the blocks of a mosaic, and put into a calibration."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.colorimetry import D50, SRGB_TO_XYZ, Matrix, xyz
from panchroma.shared.lights import illuminant_xy
from panchroma.shared.white_balance import balanced, estimate_neutral
from panchroma.tools.io.display import ColourTransform
from panchroma.tools.simulation.sensor import simulate_additive

CAMERA = SensorCalibration.of_bits(12)
LIGHT = (0.45, 1.0, 0.62)


def shot(
    light: tuple[float, ...] = LIGHT,
    level: float = 0.8,
    period: int = 6,
    origin: tuple[int, int] = (0, 0),
) -> Mosaic:
    """A grey scene of all brightnesses under a coloured light."""
    grey = np.random.default_rng(0).uniform(0.05, 1, (15, 20, 1)).repeat(10, 0).repeat(10, 1)
    rgb = (level * grey * np.array(light)).astype(np.float32)
    pattern, random = CfaPattern.bayer(period, origin=origin), np.random.default_rng(1)
    return simulate_additive(rgb, pattern, CAMERA, 0.002, random)


@pytest.mark.parametrize("origin", [(0, 0), (5, 0), (3, 5)])
@pytest.mark.parametrize("period", [4, 6])
def test_the_estimate_is_the_light_wherever_the_blocks_lie(
    period: int, origin: tuple[int, int]
) -> None:
    assert estimate_neutral(shot(period=period, origin=origin)) == pytest.approx(LIGHT, abs=0.05)


def test_hot_pixels_are_not_the_light() -> None:
    mosaic = shot()
    samples = mosaic.signal.copy()
    rows, columns = mosaic.pattern.lattices[0][1:]
    samples[rows, columns][::5, ::7] = 2.5
    found = estimate_neutral(Mosaic(samples, mosaic.pattern, CAMERA))
    assert found == pytest.approx(LIGHT, abs=0.03)


@pytest.mark.parametrize("level", [0.0, 0.005, 50.0])
def test_a_frame_that_shows_no_light_has_no_estimate(level: float) -> None:
    assert estimate_neutral(shot(level=level)) is None


@pytest.mark.parametrize("matrix", [None, tuple(map(tuple, SRGB_TO_XYZ / np.array(LIGHT)))])
def test_a_balanced_calibration_shows_its_neutral_as_grey(matrix: Matrix | None) -> None:
    known = SensorCalibration.of_bits(12, camera_to_xyz=matrix, neutral=LIGHT if matrix else None)
    other = balanced(known, np.array((0.9, 0.6, 0.3)))
    transform = ColourTransform.to_space(other, "linear-srgb")
    seen = transform.apply(np.array([[other.neutral]], np.float32))
    assert np.ptp(seen) < 1e-5
    assert other.neutral == pytest.approx((1.0, 0.6 / 0.9, 0.3 / 0.9))
    if other.camera_to_xyz is not None:
        white = np.array(other.camera_to_xyz) @ other.neutral
        assert white / white[1] == pytest.approx(D50, abs=1e-3)


def test_an_estimate_is_marked_and_can_be_left_out() -> None:
    marked = balanced(CAMERA, np.array(LIGHT), estimated=True)
    assert marked.without_estimates() == CAMERA != marked


SKIN, WALL = (0.60, 0.36, 0.26), (0.55, 0.45, 0.33)
TUNGSTEN, DAYLIGHT, SHADE = ("2850", "5500", "8000")


def read_by(matrix: Matrix, kelvin: str) -> np.ndarray:
    """What a camera with this matrix reads of white under a light, largest channel 1."""
    reading = np.linalg.solve(np.array(matrix), xyz(*illuminant_xy(kelvin)))
    return np.asarray(reading / reading.max())


def portrait(light: np.ndarray) -> np.ndarray:
    """A round face before a warm wall."""
    y, x = np.mgrid[-1:1:240j, -1:1:240j][..., None]
    depth = 1 - (x / 0.75) ** 2 - (y / 0.9) ** 2
    face, wall = np.array(SKIN) * (0.3 + np.sqrt(depth.clip(0))), np.array(WALL) * (0.8 + 0.2 * x)
    return (0.8 * light * np.where(depth > 0, face, wall)).astype(np.float32)


def apart(one: ArrayLike, other: ArrayLike) -> float:
    """The angle between two neutrals, degrees."""
    ones, others = np.asarray(one), np.asarray(other)
    cosine = ones @ others / np.linalg.norm(ones) / np.linalg.norm(others)
    return float(np.degrees(np.arccos(cosine.clip(-1, 1))))


OWN = np.array([[0.9, 0.25, 0.05], [0.2, 1.0, 0.1], [0.02, 0.2, 0.8]])
MATRICES = [SRGB_TO_XYZ, tuple(map(tuple, (SRGB_TO_XYZ @ OWN).tolist()))]


@pytest.mark.parametrize("matrix", MATRICES)
@pytest.mark.parametrize("kelvin", [TUNGSTEN, DAYLIGHT, SHADE])
def test_a_face_that_fills_the_picture_is_not_taken_for_a_light_that_there_is_not(
    kelvin: str, matrix: Matrix
) -> None:
    light = read_by(matrix, kelvin)
    known = SensorCalibration.of_bits(12, camera_to_xyz=matrix)
    random = np.random.default_rng(1)
    mosaic = simulate_additive(portrait(light), CfaPattern.bayer(), known, 0.01, random)
    blind = Mosaic(mosaic.codes, mosaic.pattern, CAMERA)
    limited, free = estimate_neutral(mosaic), estimate_neutral(blind)
    assert apart(limited, light) <= apart(free, light) + 1
    possible = [read_by(matrix, str(kelvin)) for kelvin in range(2500, 10001, 50)]
    assert min(apart(limited, neutral) for neutral in possible) < 3
    if kelvin == TUNGSTEN:
        assert apart(limited, light) < apart(free, light) - 0.5


def test_what_was_never_balanced_keeps_its_green() -> None:
    """A camera's own channels in a file that says they are those of sRGB."""
    for light in (LIGHT, (0.62, 1.0, 0.57), (0.74, 1.0, 0.42), (0.97, 1.0, 0.28)):
        mosaic = shot(light)
        known = SensorCalibration.of_bits(12, camera_to_xyz=SRGB_TO_XYZ, neutral=(1, 1, 1))
        stated = Mosaic(mosaic.codes, mosaic.pattern, known)
        assert estimate_neutral(stated) == pytest.approx(light, abs=0.05)
