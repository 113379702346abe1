"""What photographs are like before a sensor sees them: cross-spectra of luminance and colour, measured on photographs.

Photographs are neither smooth nor busy everywhere, so their squares are sorted by fine colour into classes, each with a spectrum of
its own. Luminance comes first, and edges guide colour: of the detail of colour, what a local linear function of luminance predicts
(He, Sun, Tang 2010) counts as known. What is left is the prior of colour, given luminance.
"""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.arrays import DoubleArray
from shared.errors import InputError

SHARES = (0.5, 0.4, 0.1)
"""Shares of the classes: the calm half of all squares, the busy ones, and the tenth with most fine colour."""
SQUARE = 32  # pixels
_GUIDE, _SMOOTH = 8, 6.0  # pixels: radius of the linear functions, and standard deviation of what is no detail
_FLAT = 1e-6  # variance of luminance below which it guides nothing
_FINE = 1 / 16  # cycles per pixel, from which on colour counts as fine
_LEVELS, _TINY = 20, 1e-12  # levels of fine colour per power of ten, and what keeps its logarithm finite
_TABLE = "spectra.json"
ComplexArray = NDArray[np.complex128]
_PARTS = ((0, 0), (0, 2), (1, 1), (2, 2))
_DIGITS = 3


@dataclass(frozen=True, eq=False)
class Spectra:
    """Power of photographs, class by class, in scene units squared.

    light: mean of the channels in each class, scene units, (3,).
    power: (3, 17, 17, 3, 3): covariance of the three planes of `basis(3)` at multiples of 1/32 cycles per pixel down and across.
        White noise of variance 1 has power 1. Mirrored frequencies are alike, and so are red and blue.
    """

    light: DoubleArray
    power: DoubleArray

    @classmethod
    def measured(cls, pictures: Iterable[DoubleArray]) -> "Spectra":
        """Measure pictures, each (H, W, 3), scene units. Raises InputError for too few squares of 32 pixels."""
        sums: dict[int, list[Any]] = {}  # of squares with about as much fine colour: number, light, power
        for picture in pictures:
            for level, light, waves in _squares(picture):
                known = sums.setdefault(level, [0, 0.0, 0.0])
                known[0] += len(light)
                known[1] += light.sum()
                known[2] += np.einsum("nyxa,nyxb->yxab", waves, waves.conj()).real
        ordered = [sums[level] for level in sorted(sums)]
        counts = np.array([count for count, *_ in ordered])
        ranks = (np.cumsum(counts) - counts / 2) / counts.sum()
        classes = np.searchsorted(np.cumsum(SHARES)[:-1], ranks)
        members = [[each for each, kind in zip(ordered, classes, strict=True) if kind == wanted] for wanted in range(len(SHARES))]
        if not all(members):
            raise InputError(
                f"too few squares of {SQUARE} x {SQUARE} pixels to tell calm ones from busy ones; give more photographs"
            )
        totals = [[sum(part) for part in zip(*kind, strict=True)] for kind in members]
        return cls(
            np.array([light / size for size, light, _ in totals]), np.stack([_folded(power / size) for size, _, power in totals])
        )

    @classmethod
    def decode(cls, text: str) -> "Spectra":
        """Inverse of `encode`."""
        document = json.loads(text)
        count = SQUARE // 2 + 1
        power = np.zeros((len(SHARES), count, count, 3, 3))
        rows, columns = np.triu_indices(count)
        for (plane, other), values in zip(_PARTS, np.moveaxis(np.array(document["power"]), 1, 0), strict=True):
            for down, across in ((rows, columns), (columns, rows)):
                power[:, down, across, plane, other] = power[:, down, across, other, plane] = values
        return cls(np.array(document["light"]), power)

    def encode(self) -> str:
        """The spectra as a small JSON file."""
        rows, columns = np.triu_indices(SQUARE // 2 + 1)
        power = [[_rounded(each[rows, columns, plane, other]) for plane, other in _PARTS] for each in self.power]
        return json.dumps({"light": _rounded(self.light), "power": power})

    def at(self, frequencies: DoubleArray, channels: int) -> DoubleArray:
        """Power of the planes of `basis(channels)` at frequencies (..., 2), cycles per pixel: (3, ..., channels, channels).

        Between measured frequencies it is interpolated linearly, which keeps it positive definite. For another number of channels
        than three, luminance has the power measured, and each other plane the mean of both planes of colour, so that a channel has
        as much of it as red, green and blue.
        """
        places = np.abs((frequencies + 0.5) % 1 - 0.5) * SQUARE
        first = np.minimum(places.astype(int), SQUARE // 2 - 1)
        down, across = np.moveaxis(places - first, -1, 0)[..., None, None]
        row, column = np.moveaxis(first, -1, 0)
        known: DoubleArray = (1 - down) * (1 - across) * self.power[:, row, column] + down * (1 - across) * self.power[
            :, row + 1, column
        ]
        known += (1 - down) * across * self.power[:, row, column + 1] + down * across * self.power[:, row + 1, column + 1]
        if channels == 3:
            return known
        colour = (known[..., 1, 1] + known[..., 2, 2]) / 3 * channels / (channels - 1)
        found: DoubleArray = np.eye(channels) * colour[..., None, None]
        found[..., 0, 0] = known[..., 0, 0] * channels / 3
        return found


@cache
def shipped() -> Spectra:
    """The spectra that `python -m tools.evaluation.design` measured on photographs to learn from."""
    return Spectra.decode(files(__package__).joinpath(_TABLE).read_text("utf-8"))


def basis(channels: int) -> DoubleArray:
    """Orthonormal planes of a scene, (channels, channels), one in a row: luminance, then differences of channels.

    The second of three is red minus blue, so that exchanging these two changes its sign alone.
    """
    planes: DoubleArray = np.array([[1.0, 1, 1], [1, 0, -1], [-1, 2, -1]])
    if channels != 3:
        planes = np.linalg.qr(np.column_stack([np.ones(channels), np.eye(channels)[:, 1:]]))[0].T
    planes /= np.linalg.norm(planes, axis=1)[:, None]
    return planes


def _squares(picture: DoubleArray) -> Iterator[tuple[int, DoubleArray, ComplexArray]]:
    """Squares of a picture with about as much fine colour: how much, mean light (n,), and waves (n, 32, 32, 3) of the planes."""
    from scipy.ndimage import gaussian_filter

    planes, light = picture @ basis(3).T, picture.mean(axis=2)
    for plane in (1, 2):
        guided = _guided(planes[..., plane], light)
        planes[..., plane] += gaussian_filter(guided, _SMOOTH) - guided
    lit, cells = _cut(light[..., None]), _cut(planes)
    if not len(cells):
        return
    window = np.hanning(SQUARE + 1)[:SQUARE]
    window = np.outer(window, window)[..., None]
    waves = np.fft.fft2((cells - cells.mean(axis=(1, 2), keepdims=True)) * window, axes=(1, 2)) / np.sqrt((window**2).sum())
    frequencies = np.fft.fftfreq(SQUARE)
    fine = np.hypot(frequencies[:, None], frequencies) > _FINE
    energy = (np.abs(waves[:, fine, 1:]) ** 2).sum(axis=(1, 2))
    levels = np.floor(np.log10(energy + _TINY) * _LEVELS).astype(int)
    for level in np.unique(levels).tolist():
        yield level, lit[levels == level].mean(axis=(1, 2, 3)), waves[levels == level]


def _cut(planes: DoubleArray) -> DoubleArray:
    """The squares of planes (H, W, C) that lie side by side: (n, 32, 32, C)."""
    down, across = (size // SQUARE for size in planes.shape[:2])
    rows = planes[: down * SQUARE, : across * SQUARE].reshape(down, SQUARE, across, SQUARE, -1)
    return rows.swapaxes(1, 2).reshape(down * across, SQUARE, SQUARE, -1)


def _guided(plane: DoubleArray, guide: DoubleArray) -> DoubleArray:
    """The linear function of the guide that fits the plane best around each pixel, smoothed: both (H, W)."""
    from scipy.ndimage import uniform_filter

    def mean(values: DoubleArray) -> DoubleArray:
        return uniform_filter(values, 2 * _GUIDE + 1)

    slope = (mean(plane * guide) - mean(plane) * mean(guide)) / (mean(guide * guide) - mean(guide) ** 2 + _FLAT)
    return mean(slope) * guide + mean(mean(plane) - slope * mean(guide))


def _folded(power: DoubleArray) -> DoubleArray:
    """Covariance of waves (32, 32, 3, 3) at frequencies from 0 on, (17, 17, 3, 3); mirrored and turned pictures count alike."""
    mirrored = -np.arange(SQUARE) % SQUARE
    power = (power + power[mirrored]) / 2
    power = (power + power[:, mirrored]) / 2
    power = (power + power.swapaxes(0, 1)) / 2
    power[..., [0, 1, 1, 2], [1, 0, 2, 1]] = 0  # red and blue may be exchanged
    return power[: SQUARE // 2 + 1, : SQUARE // 2 + 1]


def _rounded(values: DoubleArray) -> list[float]:
    return [float(f"{value:.{_DIGITS}g}") for value in values]
