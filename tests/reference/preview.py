"""The camera's preview, pixel by pixel and block by block, in double precision and scene units. Slow and literal.

The weights of interpolation come from `device.preview.geometry`, which has its own tests; constants stand here once more.
"""

from collections.abc import Callable
from itertools import product

import numpy as np

from device.preview.geometry import Geometry
from shared import Mosaic
from shared.arrays import DoubleArray
from shared.display import SATURATED
from tests.reference.chromaticity import solve_block

FLOOR, STILL = 1e-3, 1e-4  # of luminance
GAP, GAP_NOISE, MISSED_NOISE, CONTRAST_ERROR = 12.0, 8.0, 2.0, 0.5
NEAR, CHANNELS = 0.35, 0.4  # of errors at the sites
LEAST_VARIANCE, PRIOR, POOLING, MISREAD = 1e-6, 0.5, 3e-4, 1.4e-3  # of chromaticity, from here on
ALIKE, ALIKE_NOISE, ALIKE_STROKES, STROKES = 0.13, 24.0, 0.15, 8.0
CONTRAST, NOISE_WEIGHT, CONTRAST_STROKES, SPREAD = 0.1, 4.0, 0.5, 0.5
Sample = Callable[[int, int], float]


def sampler(mosaic: Mosaic) -> Sample:
    """The signal at any pixel, inside the frame or not."""
    pattern, (height, width) = mosaic.pattern, mosaic.shape
    period = pattern.period
    planes = pattern.filter_map((period, period))

    def plane(row: int, column: int) -> int:
        return int(planes[row % period, column % period])

    def nearest(place: int, size: int) -> int:
        alike = [each for each in range(size) if (each - place) % period == 0]
        return min(alike, key=lambda each: abs(each - place)) if alike else min(max(place % period, 0), size - 1)

    def sample(row: int, column: int) -> float:
        image = nearest(row, height), nearest(column, width)
        number = plane(row, column)
        calibration = mosaic.calibration
        return float((int(mosaic.codes[image]) - calibration.black_level[number]) * calibration.scale()[number])

    return sample


class Block:
    """What a block measures: luminance at its sites, their mean, its noise and its chromaticity."""

    def __init__(self, sample: Sample, mosaic: Mosaic, place: tuple[int, int], scale: int) -> None:
        geometry = Geometry(mosaic.pattern, scale)
        origins = zip(mosaic.pattern.block_origin, place, strict=True)
        top, left = (origin + number * mosaic.pattern.period for origin, number in origins)
        rows, columns = geometry.window
        seen = np.array([[sample(top + row, left + column) for column in columns] for row in rows])
        along, down, row_steps, column_steps, colours, *_ = np.split(
            (geometry.probes.astype(float) * seen).sum(axis=(1, 2)), np.cumsum(geometry.kinds)[:-1]
        )
        colours = colours / [len(sites) for sites in geometry.readings]
        self.noise = mosaic.calibration.noise
        least = STILL + 2 * self._variance(down[0])
        row_change, column_change = np.mean(row_steps**2) + least, np.mean(column_steps**2) + least
        weights = 1 / row_change, 1 / column_change
        self.contrast = max(row_change, column_change) - least
        self.change = row_change + column_change
        self.filled = (weights[0] * along + weights[1] * down) / sum(weights)
        self.luminance = float(self.filled.mean())
        self.variance = self._variance(self.luminance)
        self.colours = colours
        channels = range(len(mosaic.pattern.channels))
        at = [[number for number, sites in enumerate(geometry.readings) if sites[0][2] == channel] for channel in channels]
        samples = [[float(colours[number]) for number in numbers] for numbers in at]
        # Eq. 7: beside saturated samples those of the block say how much light there is.
        gamma = np.array(mosaic.calibration.gamma)
        gap = float(gamma @ list(map(np.mean, samples))) - self.luminance
        self.change += GAP * max(gap**2 - GAP_NOISE * gamma @ gamma * self._variance(down[0]), 0)
        first, last = np.array(SATURATED) * mosaic.calibration.full_scale
        above = min(max((self.luminance - first) / (last - first), 0), 1) * max(gap, 0)
        lights = [[float(self.filled[number]) + above for number in numbers] for numbers in at]
        least_variance = LEAST_VARIANCE * mosaic.calibration.scale()[-1] ** 2
        sigma = max(PRIOR * self.variance, least_variance) ** 0.5
        self.chromaticity = solve_block(samples, lights, mosaic.calibration.gamma, sigma)
        self.light: float = max(self.luminance, FLOOR)
        self.colours_of_light = self.light * self.chromaticity * np.array(mosaic.calibration.gamma)
        self.alike = ALIKE * self.light**2 + ALIKE_NOISE * self.variance
        strokes = max(self.change - 2 * (STILL + 2 * self.variance), 0)
        self.alike += ALIKE_STROKES * strokes
        self.limit = CONTRAST * self.light**2 + NOISE_WEIGHT * self.variance
        self.limit *= self.light**2 / (self.light**2 + CONTRAST_STROKES * strokes)
        self.sure = self.light**2 / (self.light**2 + STROKES * strokes)
        self.misread = self.variance + MISREAD * self.change

    def settled(self, chromaticity: DoubleArray, mosaic: Mosaic) -> DoubleArray:
        """`filled`, corrected by what chromaticity times luminance misses of the samples (`shared.site_errors`)."""
        sites, gamma = Geometry(mosaic.pattern).sites, np.array(mosaic.calibration.gamma)
        channels = [channel for _, _, channel in sites]
        missed = (self.colours - chromaticity[channels] * self.filled) * gamma[channels]
        power, noise = np.mean(missed**2), self._variance(self._mean_light(gamma[channels])) * np.mean(gamma[channels] ** 2)
        contrast = CONTRAST_ERROR * self.contrast
        share = max(power - MISSED_NOISE * noise, 0) * contrast / max(power * (contrast + power), 1e-30)
        # The most probable errors of every channel at every site, given those of the measured ones; then their sum, luminance.
        count = len(gamma)
        places = np.array([site[:2] for site in sites], float)
        near = NEAR ** np.linalg.norm(places[:, None] - places, axis=2)
        every = np.kron(near, np.where(np.eye(count) > 0, 1, CHANNELS))
        seen = [number * count + channel for number, channel in enumerate(channels)]
        errors = every[:, seen] @ np.linalg.solve(every[np.ix_(seen, seen)], missed)
        return self.filled + share * errors.reshape(-1, count).sum(axis=1)

    def _mean_light(self, gamma: DoubleArray) -> float:
        return float(self.colours @ gamma / gamma.sum())

    def _variance(self, luminance: float) -> float:
        return self.noise.sigma(max(luminance, 0)) ** 2 if self.noise else 0.0


class Colours:
    """The chromaticity of every block, and its spread over the cells, for a picture of one scale."""

    def __init__(self, mosaic: Mosaic, scale: int = 1) -> None:
        self._mosaic, self._scale = mosaic, scale
        self._sample = sampler(mosaic)
        self._known: dict[tuple[int, int], Block] = {}

    def block(self, row: int, column: int) -> Block:
        if (row, column) not in self._known:
            self._known[row, column] = Block(self._sample, self._mosaic, (row, column), self._scale)
        return self._known[row, column]

    def similar(self, one: tuple[int, int], other: tuple[int, int]) -> float:
        first, second = self.block(*one), self.block(*other)
        apart = float(np.sum((first.colours_of_light - second.colours_of_light) ** 2))
        limit = min(first.alike, second.alike)
        return float((limit / (limit + apart)) ** 2)

    def chromaticity(self, row: int, column: int) -> DoubleArray:
        """Own colour, and that of the blocks around: twice along the row of the means along each column."""
        own = self.block(row, column)

        def along_column(right: int) -> DoubleArray:
            here = row, right
            others = [(row + down, right) for down in (-1, 1)]
            total: DoubleArray = self.block(*here).sure * self.block(*here).colours_of_light
            for each in others:
                total = total + self.similar(here, each) * self.block(*each).sure * self.block(*each).colours_of_light
            return total

        def along_row(right: int, times: int) -> DoubleArray:
            if not times:
                return along_column(right)
            total: DoubleArray = along_row(right, times - 1)
            for other in (right - 1, right + 1):
                total = total + self.similar((row, right), (row, other)) * along_row(other, times - 1)
            return total

        total = own.colours_of_light * POOLING * own.light**2 + own.misread * along_row(column, 2)
        return total / total.sum() / np.array(self._mosaic.calibration.gamma)

    def spread(self, row: int, column: int, light: Sample) -> DoubleArray:
        """The colour of the cell around a sensor pixel; light: that of the part of the picture that begins at any pixel."""
        geometry, pattern = Geometry(self._mosaic.pattern, self._scale), self._mosaic.pattern
        corner, cell, place = [], [], []
        for value, origin, half in zip((row, column), pattern.block_origin, geometry.half, strict=True):
            patch, inside = divmod(value - origin - half, pattern.period)
            number = inside // geometry.cell
            corner.append(patch)
            cell.append(origin + half + patch * pattern.period + number * geometry.cell)
            place.append((number + 0.5) * geometry.cell / pattern.period)
        steps = range(0, geometry.cell, self._scale)
        mean = np.mean([light(cell[0] + down, cell[1] + right) for down, right in product(steps, repeat=2)])
        total, weight = np.zeros(len(pattern.channels)), 0.0
        for down, right in product((0, 1), repeat=2):
            each = self.block(corner[0] + down, corner[1] + right)
            near = (place[0] if down else 1 - place[0]) * (place[1] if right else 1 - place[1])
            part = near**SPREAD * each.limit / ((mean - each.light) ** 2 + each.limit)
            total, weight = total + part * self.chromaticity(corner[0] + down, corner[1] + right), weight + part
        return total / weight


def preview(mosaic: Mosaic) -> DoubleArray:
    """Camera RGB, scene units, (H, W, C), of a full-resolution preview."""
    pattern, (height, width) = mosaic.pattern, mosaic.shape
    geometry, sample, colours = Geometry(pattern), sampler(mosaic), Colours(mosaic)
    settled: dict[tuple[int, int], DoubleArray] = {}

    def filled(row: int, column: int) -> DoubleArray:
        if (row, column) not in settled:
            settled[row, column] = colours.block(row, column).settled(colours.chromaticity(row, column), mosaic)
        return settled[row, column]

    def luminance(row: int, column: int) -> float:
        place = row - pattern.block_origin[0], column - pattern.block_origin[1]
        (down, site_row), (right, site_column) = (divmod(value, pattern.period) for value in place)
        for number, (*site, _) in enumerate(geometry.sites):
            if site == [site_row, site_column]:
                return float(filled(down, right)[number])
        return sample(row, column)

    picture = np.empty((height, width, len(pattern.channels)))
    for row, column in product(range(height), range(width)):
        picture[row, column] = luminance(row, column) * colours.spread(row, column, luminance)
    return picture


def small_preview(mosaic: Mosaic, scale: int) -> DoubleArray:
    """Camera RGB, scene units, (H // scale, W // scale, C), of a smaller preview."""
    pattern, sample, colours = mosaic.pattern, sampler(mosaic), Colours(mosaic, scale)
    planes, clear = pattern.filter_map((pattern.period, pattern.period)), len(pattern.channels)
    # Pixels of the picture begin where patches do; the first covers the middle of the first `scale` rows and columns.
    begins = [origin + half for origin, half in zip(pattern.block_origin, Geometry(pattern).half, strict=True)]
    first = [begin + ((scale - 1) // 2 - begin) // scale * scale for begin in begins]

    def light(row: int, column: int) -> float:
        inside = [(row + down, column + right) for down, right in product(range(scale), repeat=2)]
        return float(np.mean([sample(*each) for each in inside if planes[each[0] % len(planes), each[1] % len(planes)] == clear]))

    picture = np.empty((mosaic.shape[0] // scale, mosaic.shape[1] // scale, len(pattern.channels)))
    for row, column in product(range(picture.shape[0]), range(picture.shape[1])):
        at = first[0] + row * scale, first[1] + column * scale
        picture[row, column] = light(*at) * colours.spread(*at, light)
    return picture
