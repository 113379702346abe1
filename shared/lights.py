"""The colours of a camera under two lights, and under any light in between: DNG 1.7.1, chapter 6.

A ColorMatrix maps CIE XYZ under one light to channels. Between two lights it is linear in the
inverse of the correlated colour temperature, which is the one at which the matrix takes what white
reads to a white of just this temperature. There is no ForwardMatrix: with it, colours of a Sigma SD
Merrill at 4000 K, calibrated under A and D65, would be 1.2 to 1.5 times as far off.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .arrays import DoubleArray
from .colorimetry import BRADFORD, D50, D65_XY, Matrix, adaptation, as_rows, xyz
from .errors import InputError
from .figures import numbers, shown

Chromaticity = tuple[float, float]  # CIE 1931 x, y
LightMatrices = Sequence[tuple[Chromaticity, DoubleArray]]
"""Lights, each with its matrix from CIE XYZ to channels."""
Factors = Sequence[DoubleArray] | None
"""For each light what the camera reads of what the ColorMatrix says, (C, C): DNG's AnalogBalance
times CameraCalibration; None = the same.
"""

ILLUMINANTS: dict[str, Chromaticity] = {  # CIE 15:2018, table T.3
    "A": (0.44758, 0.40745),
    "D50": (0.34567, 0.35851),
    "D55": (0.33243, 0.34744),
    "D65": D65_XY,
    "D75": (0.29903, 0.31488),
}
GAMMA_RANGE = (1e-3, 1e3)
COLOUR_RANGE = (1e-6, 1e6)  # of a column's largest figure, and of a neutral


def illuminant_xy(name: str) -> Chromaticity:
    """Chromaticity of a key of `ILLUMINANTS`, or of 2000 to 10000 kelvin: a black body below 5000
    K, daylight from there on.

    Raises
    ------
    InputError
        For anything else.

    Examples
    --------
    >>> from panchroma.shared.lights import illuminant_xy
    >>> [round(value, 3) for value in illuminant_xy("4000")]
    [0.38, 0.377]
    """
    if isinstance(name, str) and name in ILLUMINANTS:
        return ILLUMINANTS[name]
    low, high = 2000.0, 10000.0  # K; McCamy's formula is off by 1.2 % at most there
    kelvin = float(name) if isinstance(name, str) and name.isascii() and name.isdigit() else 0.0
    if not low <= kelvin <= high:
        expected = f"expected {', '.join(ILLUMINANTS)}, or {low:g} to {high:g} kelvin"
        raise InputError(f"the light is {shown(name)}, {expected}")
    # daylight, as CIE 13.3 chooses its reference illuminants: CIE 15:2018, 4.1.2
    if kelvin >= 5000:
        cubic = (-4.607e9, 2.9678e6, 99.11, 0.244063)
        if kelvin > 7000:
            cubic = (-2.0064e9, 1.9018e6, 247.48, 0.237040)
        x = float(np.polyval(cubic, 1 / kelvin))
        return x, -3 * x * x + 2.87 * x - 0.275
    # M. Krystek, "An algorithm to calculate correlated colour temperature", Color Research &
    # Application 10 (1985)
    over, under = (1.28641212e-7, 1.54118254e-4, 0.860117757), (7.08145163e-7, 8.42420235e-4, 1)
    u = np.polyval(over, kelvin) / np.polyval(under, kelvin)
    over, under = (4.20481691e-8, 4.22806245e-5, 0.317398726), (1.61456053e-7, -2.89741816e-5, 1)
    v = np.polyval(over, kelvin) / np.polyval(under, kelvin)
    return float(3 * u / (2 * u - 8 * v + 4)), float(2 * v / (2 * u - 8 * v + 4))


def temperature(white: Chromaticity) -> float:
    """Correlated colour temperature in kelvin (C. S. McCamy, Color Research & Application 17,
    1992).

    Examples
    --------
    >>> from panchroma.shared.lights import ILLUMINANTS, temperature
    >>> [round(temperature(ILLUMINANTS[name])) for name in ("A", "D50", "D65")]
    [2857, 5002, 6505]
    """
    x, y = white
    # Redder light than of 1620 K counts as such, and deep blue as very hot: beyond, the polynomial
    # would turn.
    slope = max((0.3320 - x) / max(y - 0.1858, 1e-3), -1.28)
    return float(np.polyval((449.0, 3525.0, 6823.3, 5520.33), slope))


@dataclass(frozen=True)
class CalibratedLight:
    """The colours of a camera under one light; every field is checked (InputError names the field).

    Attributes
    ----------
    illuminant : str
        A key of `ILLUMINANTS`, or a temperature in kelvin as text: see `illuminant_xy`.
    camera_to_xyz : Matrix
        3 x C, scene units -> CIE XYZ (D50 white).
    neutral : tuple[float, ...]
        (C,), what a white surface reads, up to scale.
    gamma : tuple[float, ...] | None
        (C,), the weights of Eq. 7 under this light; None = those of the camera.
    """

    illuminant: str
    camera_to_xyz: Matrix
    neutral: tuple[float, ...]
    gamma: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        illuminant_xy(self.illuminant)
        for name, (least, most) in {"neutral": COLOUR_RANGE, "gamma": GAMMA_RANGE}.items():
            if name == "gamma" and self.gamma is None:
                continue
            values = numbers(f"calibration: lights.{name}", getattr(self, name))
            if not all(least <= value <= most for value in values):
                expected = f"expected {least:g} to {most:g}"
                raise InputError(f"calibration: lights.{name} is {values}, {expected}")
            object.__setattr__(self, name, values)
        matrix = checked_matrix(self.camera_to_xyz, len(self.neutral))
        object.__setattr__(self, "camera_to_xyz", matrix)

    @property
    def white(self) -> Chromaticity:
        """CIE x, y of the light."""
        return illuminant_xy(self.illuminant)

    @property
    def xyz_to_camera(self) -> DoubleArray:
        """DNG's ColorMatrix: CIE XYZ under this light -> channels, (C, 3), which read 1 at most
        where XYZ is D50.

        With more channels than three it is the one with the least figures, of which `camera_to_xyz`
        is the inverse.
        """
        to_xyz = adaptation(D50, xyz(*self.white)) @ np.array(self.camera_to_xyz)
        return to_one(np.linalg.pinv(to_xyz))


Lights = tuple[CalibratedLight, CalibratedLight]


def checked_lights(values: Any, channels: str) -> Lights:
    """Two lights for a camera with these channels, the lower temperature first.

    Raises
    ------
    InputError
        Unless they differ.
    """
    if len(values) != 2 or not all(isinstance(value, CalibratedLight) for value in values):
        raise InputError(f"calibration: lights is {shown(values)}, expected two lights")
    warm, cold = sorted(values, key=lambda light: temperature(light.white))
    counts = {len(each) for light in values for each in (light.neutral, light.gamma or channels)}
    if counts != {len(channels)}:
        raise InputError(f"calibration: lights have other channels than {channels}")
    check_apart(warm.illuminant, cold.illuminant)
    if (warm.gamma is None) != (cold.gamma is None):
        raise InputError("calibration: one of the lights has a gamma, the other has none")
    return warm, cold


def without_gamma(lights: Lights | None) -> Lights | None:
    """Return the lights with the gamma of the camera."""
    return lights and (replace(lights[0], gamma=None), replace(lights[1], gamma=None))


def check_apart(first: str, second: str) -> None:
    """Raise InputError unless these are two lights, of different temperatures."""
    warm, cold = sorted(temperature(illuminant_xy(name)) for name in (first, second))
    # nearer lights hardly differ, and the line through their matrices is noise
    if cold < 1.1 * warm:
        reason = "take two whose temperatures are 10 % apart, such as A and D65"
        raise InputError(f"the lights {first} and {second} are alike: {reason}")


def to_one(xyz_to_camera: DoubleArray) -> DoubleArray:
    """A ColorMatrix scaled so that its largest reading of D50 is 1: DNG leaves the scale open, and
    Adobe's SDK does so.
    """
    return np.asarray(xyz_to_camera / np.abs(xyz_to_camera @ D50).max())


def mixed(lights: LightMatrices, share: float, own: Factors = None) -> DoubleArray:
    """Return the matrix from CIE XYZ to channels, (C, 3), at a share of the way from the first of
    two lights, 0, to the second, 1; or for the only one. lights, own: see `between`.
    """
    matrix = (1 - share) * to_one(lights[0][1]) + share * to_one(lights[-1][1])
    return np.asarray(((1 - share) * own[0] + share * own[-1]) @ matrix if own else matrix)


def share_of(white: Chromaticity, lights: LightMatrices) -> float:
    """Return the place of a white between the first of two lights, 0, and the second, 1."""
    inverse, first, second = (1 / temperature(xy) for xy in (white, lights[0][0], lights[1][0]))
    return float(np.clip((inverse - first) / (second - first), 0, 1))


def between(lights: LightMatrices, neutral: ArrayLike, own: Factors = None) -> Matrix | None:
    """camera_to_xyz, 3 x C, under the light in which white reads `neutral`, up to scale; it takes
    `neutral` to D50.

    Beyond the two lights the nearer matrix holds.

    Parameters
    ----------
    lights : Sequence[tuple[Chromaticity, DoubleArray]]
        Of two different ones the chromaticity, and the ColorMatrix (C, 3) for it.
    own : Factors, optional
        For each light what the camera reads of what the ColorMatrix says; None = the same.

    Returns
    -------
    Matrix | None
        None if the neutral is no colour of light.
    """
    seen = np.asarray(neutral, np.float64)
    low, high = 0.0, 1.0
    for _ in range(32):  # halvings of the interval in which the mixing ratio lies
        share = (low + high) / 2
        to_xyz = np.asarray(np.linalg.pinv(mixed(lights, share, own)), np.float64)
        white = to_xyz @ seen
        if min(BRADFORD @ white) <= 0:
            return None
        x, y, _ = white / white.sum()
        if share_of((x, y), lights) > share:
            low = share
        else:
            high = share
    matrix = adaptation(to_xyz @ seen) @ to_xyz
    return as_rows(matrix / (matrix @ seen)[1])


def colours_under(lights: Lights, neutral: Sequence[float] | None) -> Matrix:
    """camera_to_xyz, 3 x C, under the light in which white reads `neutral`, up to scale; None:
    under D50.

    Where the neutral is no colour of light, such as an estimate from a wall of leaves, the channels
    of the light whose neutral is nearest are scaled (von Kries).
    """
    pairs = [(light.white, light.xyz_to_camera) for light in lights]
    if neutral is None:
        neutral = mixed(pairs, share_of(ILLUMINANTS["D50"], pairs)) @ D50
    found = between(pairs, np.array(neutral) / np.max(neutral))
    if found is not None:
        return found
    apart = [float(np.ptp(np.log(np.array(light.neutral) / neutral))) for light in lights]
    nearest = lights[apart.index(min(apart))]
    scaled = np.array(nearest.camera_to_xyz) * nearest.neutral / neutral
    return as_rows(scaled * (np.max(neutral) / max(nearest.neutral)))


def gamma_under(lights: Lights, neutral: Sequence[float] | None) -> tuple[float, ...] | None:
    """Return the weights of Eq. 7, (C,), under the light in which white reads `neutral`, up to
    scale; None: under D50. Without a gamma of each light there is none.

    It is linear in the logarithms of the readings, which are nearly so in the inverse temperature,
    and that of the nearer light beyond the two.
    """
    warm, cold = lights
    if warm.gamma is None or cold.gamma is None:
        return None
    if neutral is None:
        pairs = [(light.white, light.xyz_to_camera) for light in lights]
        share = share_of(ILLUMINANTS["D50"], pairs)
    else:
        logs = np.log([warm.neutral, cold.neutral, neutral])
        first, second, seen = logs - logs.mean(axis=1, keepdims=True)
        way = second - first
        share = float(np.clip(way @ (seen - first) / max(way @ way, 1e-12), 0, 1))
    return tuple(((1 - share) * np.array(warm.gamma) + share * np.array(cold.gamma)).tolist())


def checked_matrix(values: Any, channels: int) -> Matrix:
    """Check a matrix from channels to XYZ and return its rows; raises InputError."""
    rows: Matrix = numbers("calibration: camera_to_xyz", values, depth=2)
    if len(rows) != 3 or any(len(row) != channels for row in rows):
        expected = f"expected 3 rows of {channels} figures"
        raise InputError(f"calibration: camera_to_xyz is {shown(values)}, {expected}")
    matrix = np.array(rows)
    largest, (least, most) = np.abs(matrix).max(axis=0), COLOUR_RANGE
    if not all(least <= figure <= most for figure in largest[largest > 0]):
        column = f"a column whose largest figure is not {least:g} to {most:g}"
        raise InputError(f"calibration: camera_to_xyz has {column}: {rows}")
    lengths = np.sqrt((matrix**2).sum(axis=0))
    # condition number, whatever the channels' own scales: beyond it a channel is nearly a mixture
    # of the others
    if not np.linalg.cond(matrix / np.where(lengths > 0, lengths, 1)) < 1e4:
        raise InputError(f"calibration: camera_to_xyz has not full rank: {rows}")
    return rows
