"""Correction of chromaticity, and of luminance at the sites, by a network that was trained on
photographs, for what one block in K x K pixels cannot measure.

The frame is cut into superpixels, K x K pixels with a block in the middle, and the pixels of a
superpixel are the network's channels (space to depth). With e1 = (1, -1, 0) / sqrt 2 and e2 = (1,
1, -2) / sqrt 6, which keep luminance, a pixel has l = (R + G + B) / 3 and colour p_k = e_k . (R, G,
B), channels times gamma. Around a superpixel, with the mean <.> of 3 x 3 superpixels, the residuals
r_s of the render at the S sites before they were corrected, and the variance v of the noise in r:

    t_k = <p_k> / <l>                         mean colour
    d_0 = l - <l>,  d_k = p_k - l t_k         departures from one luminance, and from one colour
    E = < mean r^2 + mean d_k^2 >             evidence of colour
    a = sqrt(E + 0.25 < mean d_0^2 >)         activity
    b = min(a, 4 sqrt(max(E - 0.2 <v>, 0)))   bound: a place of one colour is left alone

The network sees d_0 / a, d_k / a, r / a, t_k, log2(1 + sqrt v / a), 0.3 log2(1 + <l> / a) and b /
a. Its answer times b is added to p_k, but leads no chromaticity p_k / l out of the range of those
in 3 x 3 superpixels; then, at the sites, to l, where p_k stays, as far as other frames of a burst
do not measure l there. Clipped blocks have an infinite v, so that b is 0 around them.
`tools/training` learns from the same inputs; `models/README.md` names the pictures.

Where a superpixel is the same in another orientation, the network looks at it twice: the answer is
the mean of both.

A file in `models/` serves a block and its mirror images: superpixels are mirrored on the way in and
out. Chunks of superpixels have one size and fixed places, so that neither threads nor bands change
a bit; in a chunk the network runs on the smallest box around the superpixels that are worth it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from ...shared.arrays import FloatArray, IndexArray, Pair, mirrored
from ...shared.networks import Block, load_network, network_for
from ...shared.pattern import CfaPattern
from ..bands import DARK, Band, Halo, RowStage
from ..frame import Frame, Sites, mean_of_sites
from ..numerics.arrays import Floats1, Floats2, Floats3, Floats4, Ints1
from ..numerics.chunks import in_chunks
from ..numerics.compile import ZERO, Chunks, parallel_kernel

REACH = 5
"""Superpixels around a superpixel that a network sees."""
MARGIN = 2
"""Superpixels around a superpixel on which its inputs depend."""
SURROUNDINGS = 5
"""Inputs of the network beside those of pixels and sites: mean colour, noise, mean luminance,
bound.
"""
UNKNOWN = 1e6
"""Variance, scene units squared, of the residuals of a clipped block: above any contrast."""
GATE = 0.2
"""Multiple of the noise variance that is taken off the evidence. The networks, trained with 0.8,
already tell noise from colour: 0.2 is 0.03 dB better on 20 noisy photographs.
"""
BASIS = (np.array([[1, -1, 0], [1, 1, -2]]) / np.sqrt([[2], [6]])).astype(np.float32)
"""The two components of colour."""
WEIGHTS = np.concatenate([np.full((1, 3), 1 / 3, np.float32), BASIS])
"""Luminance and the two components of colour, by channels times gamma."""
LUMINANCE, EVIDENCE, RANGE = 0.25, 4.0, 8.0
"""Weight of luminance in activity; bound in units of the standard deviation of colour; limit of the
inputs: as in training.
"""
# scene units, and squared: they keep quotients finite
_LEAST_LUMINANCE, _LEAST_ACTIVITY = 1e-4, 1e-30
# fraction of the mean luminance, and scene units: a darker pixel's chromaticity tells little
_DIM, _LEAST_DIM = np.float32(0.2), 1e-5
# bound, a fraction of luminance, below which a correction is not worth its time, as below the
# noise: loses nothing
_FAINT = 0.01
# superpixels of a chunk down and, at most, across: wider ones leave the processor's cache
_SIDE, _WIDEST = 48, 96
_HALO = REACH + MARGIN
_THIRD = np.float32(1 / 3)
# of luminance: more makes dark specks beside edges; added is at most luminance here and around
_MOST_TAKEN = np.float32(0.4)


def network_name(pattern: CfaPattern) -> str | None:
    """Return the name of the network that corrects colour for a pattern, in the preset BEST; None
    if there is none for it.

    Examples
    --------
    >>> from panchroma.offline import network_name
    >>> from panchroma.shared import CfaPattern
    >>> network_name(CfaPattern.bayer(6)), network_name(CfaPattern.bayer(7))
    ('rggb-k6', None)
    """
    path = network_for(pattern)
    return path.stem if path else None


@dataclass(eq=False)
class ColourNetwork(RowStage):
    """Correct chromaticity by a network, and luminance at the sites.

    Attributes
    ----------
    path : Path
        One of `models/`, read when the first rows are computed: raises InputError if that is
        impossible.
    frame : Frame
        Its pattern has the network's block and period.
    """

    path: Path
    frame: Frame

    name = "learned"

    @property
    def halo(self) -> Halo:
        """A chunk, and what the network sees around it."""
        grid = self._grid
        return Halo((_HALO + 1) * grid.period, _SIDE * grid.period, grid.origin[0])

    @cached_property
    def _grid(self) -> "Superpixels":
        return Superpixels(self.frame.sites)

    def __call__(self, band: Band, rows: tuple[int, int]) -> Band:
        """These rows with their chromaticity corrected; they end where chunks do."""
        grid, network, gamma = self._grid, load_network(self.path), self.frame.gamma32
        residuals, period = Residuals(grid, band, self.frame), grid.period
        first, last = ((row - grid.origin[0]) // (_SIDE * period) for row in (rows[0], rows[1] - 1))
        # an even number of chunks in a row: two threads end together
        count = 2 * -(-grid.shape[1] // (2 * _WIDEST))
        sides = _SIDE, -(-grid.shape[1] // count)
        result, basis = band.rows(*rows), np.empty_like(BASIS)
        luminance, chromaticity = result.luminance.copy(), result.chromaticity.copy()
        sites = Block.of(self.frame.pattern).sites(period)
        numbers = np.full(period**2, -1)
        numbers[sites] = np.arange(len(sites))
        basis[:, grid.channels] = BASIS

        def correct(chunk: tuple[int, int]) -> None:
            axes = zip(chunk, sides, strict=True)
            window = [(index * side - _HALO, (index + 1) * side + _HALO) for index, side in axes]
            error, variance, kept = residuals.of(*window)
            contrast = Contrast.of(grid.cut(band, gamma, window), error, variance)
            worth = contrast.bound > np.maximum(_FAINT * contrast.own, np.sqrt(contrast.variance))
            inner = worth[REACH:-REACH, REACH:-REACH]
            box = [np.flatnonzero(inner.any(axis=axis)) for axis in (1, 0)]
            if box[0].size:
                down, across = ((int(places[0]), int(places[-1]) + 1) for places in box)
                inputs = contrast.around(down, across, REACH).inputs()[None]
                (answer,) = network.run(None, {"features": inputs})
                limited = contrast.around(down, across, 1).answered(answer[0])
                inside = [slice(_HALO + start, _HALO + end) for start, end in (down, across)]
                missing = answer[0][2 * period**2 :] * kept[tuple(inside)]
                cuts = [slice(at.start * period, at.stop * period) for at in inside]
                along = [grid.pixels(axis, window[axis])[cut] for axis, cut in enumerate(cuts)]
                places = along[0] - result.first, along[1]
                add_answer(limited, missing, numbers, basis, gamma, places, luminance, chromaticity)

        chunks = [(down, across) for down in range(first, last + 1) for across in range(count)]
        in_chunks(lambda first, _: correct(chunks[first]), len(chunks))
        return replace(result, luminance=luminance, chromaticity=chromaticity)


class Contrast(NamedTuple):
    """Pixels and blocks of h x w superpixels in terms of their surroundings, float32; the formulas
    are those of the module.

    Attributes
    ----------
    pixels, departures : FloatArray
        Luminance and the two components of colour of all pixels, and d, (3, K^2, h, w).
    error : FloatArray
        Residuals at the sites, (S, h, w).
    variance : FloatArray
        Of the noise in them, (h, w).
    own, mean : FloatArray
        Mean luminance of a superpixel, and of 3 x 3 superpixels, (h, w).
    colour : FloatArray
        t, (2, h, w).
    activity, bound : FloatArray
        (h, w), scene units.
    """

    pixels: FloatArray
    departures: FloatArray
    error: FloatArray
    variance: FloatArray
    own: FloatArray
    mean: FloatArray
    colour: FloatArray
    activity: FloatArray
    bound: FloatArray

    @classmethod
    def of(cls, pixels: FloatArray, error: FloatArray, variance: FloatArray) -> "Contrast":
        """Return the contrast of all but the outermost `MARGIN` superpixels."""
        means = pixels.mean(axis=1)
        mean, *components = _mean_around(means)
        positive = np.maximum(mean, np.float32(_LEAST_LUMINANCE))
        colour = np.stack(components) / positive
        departures = pixels[:, :, 1:-1, 1:-1].copy()
        departures[1:] -= departures[0] * colour[:, None]
        departures[0] -= mean
        squares = np.einsum("cpyx,cpyx->cyx", departures, departures)
        squares /= np.float32(departures.shape[1])
        evidence = _mean_around(np.square(_inner(error)).mean(axis=0) + squares[1:].mean(axis=0))
        activity = evidence + np.float32(LUMINANCE) * _mean_around(squares[0])
        activity = np.sqrt(np.maximum(activity, np.float32(_LEAST_ACTIVITY)))
        beyond = np.maximum(evidence - np.float32(GATE) * _inner(_mean_around(variance)), 0)
        bound = np.minimum(activity, np.float32(EVIDENCE) * np.sqrt(beyond))
        every = pixels, error, variance, means[0]
        pixels, error, variance, own = (_inner(planes, MARGIN) for planes in every)
        departures, mean, colour = map(_inner, (departures, mean, colour))
        return cls(pixels, departures, error, variance, own, mean, colour, activity, bound)

    def around(self, rows: Pair, columns: Pair, margin: int) -> "Contrast":
        """Return some of the superpixels inside the outermost `REACH`, with `margin` more on each
        side.
        """
        before, after = REACH - margin, REACH + margin
        down, across = (slice(before + first, after + end) for first, end in (rows, columns))
        return Contrast(*(planes[..., down, across] for planes in self))

    def inputs(self) -> FloatArray:
        """Return what the network sees, float32 (3 K^2 + S + SURROUNDINGS, h, w)."""
        pixels, sites = self.departures.shape[0] * self.departures.shape[1], len(self.error)
        inputs = np.empty((pixels + sites + SURROUNDINGS, *self.bound.shape), np.float32)
        scale = np.reciprocal(self.activity)
        positive = np.maximum(self.mean, np.float32(_LEAST_LUMINANCE))
        np.multiply(self.departures, scale, out=inputs[:pixels].reshape(self.departures.shape))
        np.multiply(self.error, scale, out=inputs[pixels : pixels + sites])
        inputs[-5:-3] = self.colour
        inputs[-3] = np.log2(1 + np.sqrt(self.variance) * scale)
        inputs[-2] = np.float32(0.3) * np.log2(1 + positive * scale)
        inputs[-1] = self.bound * scale
        return np.clip(inputs, -RANGE, RANGE, out=inputs)

    def answered(self, answer: FloatArray) -> "Answer":
        """Return what the network answers of colour, the first 2 K^2 of its planes, and the limits,
        for all but the outermost superpixels, (h - 2, w - 2).
        """
        dim = np.maximum(_DIM * self.own, np.float32(_LEAST_DIM))
        chromaticity = self.pixels[1:] / np.maximum(self.pixels[0], dim)
        low = minimum_filter(chromaticity.min(axis=1), (1, 3, 3))
        high = maximum_filter(chromaticity.max(axis=1), (1, 3, 3))
        every = self.bound, dim, low, high
        bound, dim, low, high = (np.ascontiguousarray(_inner(planes)) for planes in every)
        change = answer[: 2 * self.pixels.shape[1]].reshape(2, -1, *bound.shape)
        return Answer(change, bound, dim, low, high)


class Answer(NamedTuple):
    """Answer of the network for h x w superpixels, and what limits it.

    Attributes
    ----------
    change : Floats4
        Of the two components of colour, in units of the bound, (2, K^2, h, w).
    bound : Floats2
        b, scene units, (h, w).
    dim : Floats2
        Mean of the channels, scene units, below which a pixel's chromaticity tells little, (h, w).
    low, high : Floats3
        Range of p_k / l in 3 x 3 superpixels, (2, h, w).
    """

    change: Floats4
    bound: Floats2
    dim: Floats2
    low: Floats3
    high: Floats3


def _inner(planes: FloatArray, margin: int = 1) -> FloatArray:
    return planes[..., margin:-margin, margin:-margin]


def _mean_around(planes: FloatArray) -> FloatArray:
    """Return the mean of 3 x 3 superpixels, one less on each side."""
    rows = planes[..., :-2, :] + planes[..., 1:-1, :] + planes[..., 2:, :]
    return (rows[..., :-2] + rows[..., 1:-1] + rows[..., 2:]) / np.float32(9)


class Superpixels:
    """The superpixels of a frame with channels R, G and B, and their way to and from the
    orientation that the network knows.

    Mirrored, a block has as many pixels of its superpixel before it as behind it, or one less.

    Attributes
    ----------
    frame : tuple[int, int]
        (H, W).
    period : int
        K.
    origin : tuple[int, int]
        Frame row and column at which the first superpixel begins, 0 or less.
    shape : tuple[int, int]
        Number of superpixels (down, across).
    blocks : tuple[int, int]
        Index of the first superpixel (down, across) with a whole block.
    steps : tuple[int, int]
        1, or -1 along an axis that is mirrored.
    channels : list[int]
        The pattern's indices of red, green and blue.
    sites : list[int]
        Indices of the sites of a block, in their order in the mirrored block: R, G, G, B.
    """

    def __init__(self, sites: Sites) -> None:
        pattern, grid, period = sites.pattern, sites.grid, sites.grid.period
        self.frame, self.period, self.steps = grid.frame, period, Block.of(pattern).steps
        axes = list[tuple[int, int, int]]()
        for axis, whole in enumerate((grid.whole_rows, grid.whole_columns)):
            # pixels of a superpixel before its block
            before = (period - grid.block_shape[axis] + (self.steps[axis] < 0)) // 2
            start = -((before - pattern.block_origin[axis]) % period)
            count = -(-(grid.frame[axis] - start) // period)
            axes.append((start, count, (int(whole[0]) - before - start) // period))
        self.origin, self.shape, self.blocks = zip(*axes, strict=True)
        places = [np.multiply(site[:2], self.steps).tolist() for site in pattern.sites]
        self.sites = sorted(range(len(places)), key=places.__getitem__)
        self.channels = [pattern.channels.index(letter) for letter in "RGB"]

    def cut(
        self, band: Band, gamma: FloatArray, window: Sequence[Pair], weights: FloatArray = WEIGHTS
    ) -> FloatArray:
        """Return three weighted sums of R, G and B, times gamma, of some superpixels, mirrored as
        the network knows them.

        Float32 (3, K^2, h, w). The frame is mirrored at its border.

        Parameters
        ----------
        band : Band
            All rows of the frame that the superpixels show.
        window : Sequence[Pair]
            First and end of rows and columns of superpixels; they may lie outside the frame.
        weights : FloatArray, optional
            (3, 3).
        """
        rows, columns = window
        down = mirrored(self.pixels(0, rows), self.frame[0])
        across = mirrored(self.pixels(1, columns), self.frame[1])
        down = down.clip(band.first, band.end - 1) - band.first
        of_channels = np.empty_like(weights)
        of_channels[:, self.channels] = weights * gamma[self.channels]
        shape = 3, self.period**2, rows[1] - rows[0], columns[1] - columns[0]
        picture = np.empty(shape, np.float32)
        cut_superpixels(band.luminance, band.chromaticity, of_channels, down, across, picture)
        return picture

    def pixels(self, axis: int, span: Pair) -> IndexArray:
        """Rows, or columns, of the frame at pixels of superpixels, as the network knows them."""
        pixels = self.origin[axis] + np.arange(span[0] * self.period, span[1] * self.period)
        return np.ascontiguousarray(pixels[:: self.steps[axis]])


@parallel_kernel(chunks=lambda *given: given[-1].shape[2])
def cut_superpixels(
    chunks: Chunks,
    luminance: Floats2,
    chromaticity: Floats3,
    weights: Floats2,
    rows: Ints1,
    columns: Ints1,
    out: Floats4,
) -> None:
    """Write three weighted sums of three channels, times luminance, superpixel by superpixel.

    Parameters
    ----------
    luminance, chromaticity : Floats2, Floats3
        (H, W) and (H, W, 3).
    weights : Floats2
        (3, 3), of each sum.
    rows, columns : Ints1
        Those of all pixels of h x w superpixels, (h K,) and (w K,).
    out : Floats4
        (3, K^2, h, w), written.
    """
    _, _, height, width = out.shape
    period = len(rows) // height
    for down in range(chunks[0], chunks[1]):
        for pixel in range(period * period):
            row, first = rows[down * period + pixel // period], pixel % period
            for across in range(width):
                column = columns[across * period + first]
                level, colour = luminance[row, column], chromaticity[row, column]
                for plane in range(3):
                    weight = weights[plane]
                    total = weight[0] * colour[0] + weight[1] * colour[1] + weight[2] * colour[2]
                    out[plane, pixel, down, across] = total * level


@parallel_kernel(chunks=lambda answer, *_: answer.change.shape[2])
def add_answer(
    chunks: Chunks,
    answer: Answer,
    missing: Floats3,
    sites: Ints1,
    basis: Floats2,
    gamma: Floats1,
    places: tuple[Ints1, Ints1],
    luminance: Floats2,
    chromaticity: Floats3,
) -> None:
    """Add the answer for h x w superpixels to chromaticity, (H, W, 3), within its limits, and to
    luminance, (H, W). No channel gains or loses more than the luminance, but at
    sites, where luminance itself gains at most that of the pixel and of its superpixel.

    Parameters
    ----------
    missing : Floats3
        What the mean of the channels misses at sites, in units of the bound, (S, h, w).
    sites : Ints1
        Number of the site at each pixel of a superpixel, (K^2,); -1 = none.
    basis : Floats2
        e1 and e2 of the three channels, (2, 3).
    places : tuple[Ints1, Ints1]
        Rows and columns of all pixels of the superpixels, (h K,) and (w K,), also outside the
        picture.
    """
    (rows, columns), (_, _, height, width) = places, answer.change.shape
    period, (bottom, right), step = len(rows) // height, luminance.shape, np.zeros(3, np.float32)
    for down in range(chunks[0], chunks[1]):
        for pixel in range(period * period):
            row, first = rows[down * period + pixel // period], pixel % period
            for across in range(width if 0 <= row < bottom else 0):
                column = columns[across * period + first]
                level = luminance[row, column] if 0 <= column < right else ZERO
                if level <= DARK:
                    continue
                colour = chromaticity[row, column]
                safe = max(level * _THIRD, answer.dim[down, across])  # channels add up to this
                step[:] = ZERO
                for k in range(2):
                    here = ZERO
                    for channel in range(3):
                        here += basis[k, channel] * gamma[channel] * colour[channel]
                    here *= level
                    change = answer.change[k, pixel, down, across] * answer.bound[down, across]
                    change = max(change, min(answer.low[k, down, across] * safe - here, ZERO))
                    change = min(change, max(answer.high[k, down, across] * safe - here, ZERO))
                    for channel in range(3):
                        step[channel] += basis[k, channel] * change
                limit = max(level, abs(step[0]), abs(step[1]), abs(step[2]))
                for channel in range(3):
                    colour[channel] += step[channel] / (limit * gamma[channel])
                if sites[pixel] >= 0:
                    added = missing[sites[pixel], down, across] * answer.bound[down, across]
                    most = _THIRD * level + answer.dim[down, across] / _DIM
                    added = min(max(added, -_MOST_TAKEN * _THIRD * level), most)
                    after = level + added / _THIRD
                    for channel in range(3):
                        share = colour[channel] * level + added / gamma[channel]
                        colour[channel] = share / after
                    luminance[row, column] = after


class Residuals:
    """Residuals of the blocks in a band of a picture, by superpixels."""

    def __init__(self, grid: Superpixels, band: Band, frame: Frame) -> None:
        rows = frame.sites.within(band)
        error = frame.sites.residual(band, rows)[..., grid.sites]
        noise = frame.scaled_variance(rows)
        variance = np.zeros(error.shape[:2], np.float32) if noise is None else mean_of_sites(noise)
        variance = np.where(frame.unclipped[rows], variance, np.float32(UNKNOWN))
        kept = np.ones_like(variance) if frame.kept is None else frame.kept[rows]
        # one superpixel around the whole blocks stands for all beyond
        error = np.pad(error, ((1, 1), (1, 1), (0, 0)))
        variance = np.pad(variance, 1, constant_values=UNKNOWN)
        kept = np.pad(kept, 1, constant_values=1)
        self._grid, self._first = grid, (grid.blocks[0] + rows.start - 1, grid.blocks[1] - 1)
        self._values = np.concatenate([error, np.stack([variance, kept], axis=2)], axis=2)

    def of(self, rows: Pair, columns: Pair) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the residuals at the S sites of some superpixels, mirrored, the variance of their
        noise, and the share of errors that is corrected (`Frame.kept`).

        Float32 (S, h, w) and (h, w): 0 and UNKNOWN in superpixels without a whole block.
        """
        (height, width, _), (top, left) = self._values.shape, self._first
        down = (np.arange(*rows) - top).clip(0, height - 1)
        across = (np.arange(*columns) - left).clip(0, width - 1)
        seen = np.ix_(down[:: self._grid.steps[0]], across[:: self._grid.steps[1]])
        planes = np.ascontiguousarray(self._values[seen].transpose(2, 0, 1))
        return planes[:-2], planes[-2], planes[-1]
