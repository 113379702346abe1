"""Outliers and their replacements, pixel by pixel, as `find_outliers` and `mend_panchromatic` define them."""

import itertools
import math

from shared import CfaPattern
from shared.arrays import BoolArray, FloatArray
from tests.reference.geometry import letter

STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))


def good(pattern: CfaPattern, bad: BoolArray, row: int, column: int, *, panchromatic: bool = True) -> bool:
    """Whether a place is inside the frame, not marked bad, and panchromatic, or else a colour site."""
    inside = 0 <= row < bad.shape[0] and 0 <= column < bad.shape[1]
    return inside and (letter(pattern, row, column) == "W") == panchromatic and not bad[row, column]


def square(row: int, column: int, reach: int) -> list[tuple[int, int]]:
    """The places at most `reach` pixels from (row, column) in either direction, without it."""
    steps = itertools.product(range(-reach, reach + 1), repeat=2)
    return [(row + y, column + x) for y, x in steps if (y, x) != (0, 0)]


def neighbours(signal: FloatArray, pattern: CfaPattern, bad: BoolArray, row: int, column: int, reach: int) -> list[float]:
    """The good panchromatic samples at most `reach` pixels from (row, column)."""
    return [float(signal[place]) for place in square(row, column, reach) if good(pattern, bad, *place)]


def bound(signal: FloatArray, pattern: CfaPattern, gamma: tuple[float, ...], place: tuple[int, int]) -> float:
    """The least luminance that there can be at a colour site."""
    return gamma[pattern.channels.index(letter(pattern, *place))] * float(signal[place])


def bounds(
    signal: FloatArray, pattern: CfaPattern, bad: BoolArray, gamma: tuple[float, ...], row: int, column: int, reach: int
) -> list[float]:
    """Luminance around a place, sorted: good panchromatic samples, and lower bounds from colour samples that exceed them all."""
    said = neighbours(signal, pattern, bad, row, column, reach)
    brightest = max(said, default=-math.inf)
    sites = [place for place in square(row, column, reach) if good(pattern, bad, *place, panchromatic=False)]
    least = [bound(signal, pattern, gamma, place) for place in sites]
    return sorted(said + [each for each in least if each > brightest])


def brightness(
    signal: FloatArray,
    pattern: CfaPattern,
    bad: BoolArray,
    gamma: tuple[float, ...],
    place: tuple[int, int],
    noisy: float,
    floor: float,
) -> tuple[float, float]:
    """By how much colour sites beside a place are darker, and brighter, than the same site of the tiles around, beyond noise."""
    darker, brighter, period = [1.0], [1.0], pattern.period
    for y, x in square(*place, 1):
        others = [(y - period, x), (y + period, x), (y, x - period), (y, x + period)]
        usual = [bound(signal, pattern, gamma, each) for each in others if good(pattern, bad, *each, panchromatic=False)]
        if usual and good(pattern, bad, y, x, panchromatic=False):
            here, whole = bound(signal, pattern, gamma, (y, x)), max(sum(usual) / len(usual), 0.0) + floor
            darker.append((max(here + noisy, 0.0) + floor) / whole)
            brighter.append((max(here - noisy, 0.0) + floor) / whole)
    return min(darker), max(brighter)


def stands_out(
    signal: FloatArray,
    pattern: CfaPattern,
    bad: BoolArray,
    gamma: tuple[float, ...],
    place: tuple[int, int],
    contrast: float,
    deviations: float,
    floor: float,
    noise: tuple[float, float],
) -> bool:
    """Whether a sample is an outlier by the definition in `find_outliers`."""
    if not good(pattern, bad, *place):
        return False
    near, wide = (bounds(signal, pattern, bad, gamma, *place, reach) for reach in (1, 2))
    if len(near) < 3:
        return False
    noisy, value = deviations * math.sqrt(noise[0] * max(near[-1], 0.0) + noise[1] ** 2), float(signal[place])
    least, most = brightness(signal, pattern, bad, gamma, place, noisy, floor / 3)
    beyond = max(value - max(near[-1], most * near[-1]), min(near[0], least * near[0]) - value)
    return beyond > contrast * (wide[-2] - wide[1]) + noisy + floor


def replacement(signal: FloatArray, pattern: CfaPattern, bad: BoolArray, row: int, column: int) -> float:
    """The mean of opposite neighbours, weighted by the inverse square of distance and of mean change along their direction."""
    values, weights = [], []
    for down, across in STEPS:
        pair = (row - down, column - across), (row + down, column + across)
        if all(good(pattern, bad, *place) for place in pair):
            area = square(row, column, 2)
            along = [
                abs(float(signal[y, x]) - float(signal[y + down, x + across]))
                for y, x in area
                if (y + down, x + across) in area and good(pattern, bad, y, x) and good(pattern, bad, y + down, x + across)
            ]
            change = sum(along) / len(along) if along else 0.0
            values.append(float(signal[pair[0]] + signal[pair[1]]) / 2)
            flat = 1e-8 * sum(float(signal[place]) ** 2 for place in pair) + 1e-30
            weights.append(1 / ((change**2 + flat) * (down**2 + across**2)))
    if values:
        return math.fsum(v * w for v, w in zip(values, weights, strict=True)) / math.fsum(weights)
    for reach in range(1, 9):
        if around := neighbours(signal, pattern, bad, row, column, reach):
            return sum(around) / len(around)
    return float(signal[row, column])
