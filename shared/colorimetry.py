"""Published constants and formulas of colour: white points, chromatic adaptation, RGB primaries."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import DoubleArray

Matrix = tuple[tuple[float, ...], ...]  # a tuple per row, as frozen dataclasses keep it

D50 = np.array([0.9642, 1.0, 0.8249])  # CIE XYZ of the profile connection space, ICC.1:2022, 7.2.16
D65_XY = (0.3127, 0.3290)  # ITU-R BT.709, also of IEC 61966-2-1
# Bradford's cone responses: ICC.1:2022, annex E
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)

SRGB_PRIMARIES = ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060))  # IEC 61966-2-1, table 1


def xyz(x: float, y: float) -> DoubleArray:
    """CIE XYZ with Y = 1 of the chromaticity (x, y); float64 (3,)."""
    return np.array([x / y, 1.0, (1 - x - y) / y])


def adaptation(source: DoubleArray, destination: DoubleArray = D50) -> DoubleArray:
    """Matrix of the linear Bradford adaptation of XYZ from one white to another (ICC.1:2022, annex
    E); float64 (3, 3).
    """
    gain: DoubleArray = (BRADFORD @ destination) / (BRADFORD @ source)
    return np.linalg.solve(BRADFORD, gain[:, None] * BRADFORD)


def primaries_to_xyz(
    primaries: Sequence[tuple[float, float]], white: tuple[float, float] = D65_XY
) -> DoubleArray:
    """Matrix from linear RGB to XYZ relative to D50 (SMPTE RP 177, then Bradford); float64 (3, 3).
    RGB (1, 1, 1) becomes D50.

    Raises numpy.linalg.LinAlgError when the primaries lie on a line.

    Parameters
    ----------
    primaries : Sequence[tuple[float, float]]
        Chromaticities (x, y) of red, green and blue.
    white : tuple[float, float], optional
        Chromaticity (x, y) of RGB (1, 1, 1).
    """
    columns = np.stack([xyz(*primary) for primary in primaries], axis=1)
    source = xyz(*white)
    return adaptation(source) @ (columns * np.linalg.solve(columns, source))


def white_reading(camera_to_xyz: ArrayLike, neutral: Sequence[float] | None) -> DoubleArray:
    """Return the reading of white in each channel, float64 (C,): the neutral, or where that is None
    what the matrix, (3, C), maps to D50.
    """
    if neutral is None:
        return np.linalg.lstsq(np.array(camera_to_xyz), D50)[0]
    return np.array(neutral)


def as_rows(matrix: NDArray[np.floating]) -> Matrix:
    """A matrix as nested tuples, which frozen dataclasses can keep."""
    return tuple(tuple(row) for row in matrix.tolist())


SRGB_TO_XYZ = as_rows(primaries_to_xyz(SRGB_PRIMARIES))
COMPLEMENTS = {"R": "C", "G": "M", "B": "Y"}
"""The channel that a sensor with one kind of filter has beside it: all light without its own."""


def is_pair(channels: str) -> bool:
    """Return True for a primary and its complement, in any order."""
    return any(set(channels) == set(pair) for pair in COMPLEMENTS.items())


def among(matrix: ArrayLike, channels: str) -> DoubleArray:
    """A matrix (3, 3) of red, green and blue for channels that have these three among them; float64
    (3, C).

    The other channels have no colour.

    Examples
    --------
    >>> from panchroma.shared.colorimetry import among
    >>> among([[1, 2, 3]] * 3, "GNRB")[0].tolist()
    [2.0, 0.0, 1.0, 3.0]
    """
    wide = np.zeros((3, len(channels)))
    wide[:, [channels.index(letter) for letter in "RGB"]] = matrix
    return wide


def nominal_to_xyz(channels: str, neutral: Sequence[float] | None) -> DoubleArray:
    """The matrix from channels, R, G and B among them or one of these and its complement, to XYZ
    (D50) if those three have the primaries of sRGB; float64 (3, C).

    Parameters
    ----------
    neutral : Sequence[float] | None
        What white reads in each channel; None = the same. The primaries belong to balanced
        channels, where white reads 1.
    """
    balance = 1.0 if neutral is None else max(neutral) / np.array(neutral)
    columns = dict(zip("RGB", np.array(SRGB_TO_XYZ).T, strict=True))
    if is_pair(channels):
        columns |= {COMPLEMENTS[own]: sum(columns.values()) - columns[own] for own in "RGB"}
    known = [columns.get(letter, np.zeros(3)) for letter in channels]
    return np.asarray(np.stack(known, axis=1) * balance)
