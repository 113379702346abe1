"""Luminance in a preview graph: of the blocks, of every pixel at full resolution, and of the pixels
of a smaller picture.
"""

from typing import NamedTuple

import numpy as np

from . import contract
from .nodes import END, FLOAT
from .pattern_graph import PatternGraph

_RESIDUAL_NOISE = 2.0
"""Multiple of the noise variance that the mean square of the residual at the sites of a block
must exceed to count.
"""
_CONTRAST_ERROR = 0.5
"""Squared contrast times this is the power of the residual at which half of it counts as an error
of luminance.
"""

_GAP, _GAP_NOISE = 12.0, 8.0
"""Weight of the squared gap of a block beside squared differences, and the multiple of the noise
variance that it must exceed.
"""


class Blocks(NamedTuple):
    """Light of every block, codes above black.

    Attributes
    ----------
    samples : str
        Colour samples, as panchromatic codes above black times gamma: what luminance has from a
        channel, (readings, blocks).
    filled : str
        At its colour sites, (sites, blocks).
    luminance : str
        Mean of `filled`, (1, blocks).
    gap : str
        What its samples add up to beyond that (Eq. 7), (1, blocks).
    change : str
        Sum of the mean squared differences along rows and along columns, and of the gap beyond its
        noise, (1, blocks).
    contrast : str
        The larger of the two beyond the noise, (1, blocks); "" in a smaller picture, which does not
        need it.
    """

    samples: str
    filled: str
    luminance: str
    gap: str
    change: str
    contrast: str


def measure_blocks(g: PatternGraph) -> tuple[str, ...]:
    """The probes of every block, a tensor (n, blocks) per kind, see `Geometry.probes`: what
    interpolation along rows reads more than that along columns, interpolation along columns,
    differences along rows and along columns, and `Blocks.samples`.
    """
    period, count = g.geometry.pattern.period, len(g.geometry.readings)
    weights = g.geometry.probes.copy()
    weights[:count] -= weights[count : 2 * count]
    codes = g("Cast", contract.MOSAIC, to=FLOAT) if g.geometry.scale == 1 else contract.MOSAIC
    image = g("Unsqueeze", codes, [0, 1])
    probes = g("Squeeze", g("Conv", image, weights[:, None], strides=[period, period]), [0])
    turn, columns, row_steps, column_steps, samples = g.split(probes, g.geometry.kinds, axis=0)
    channels = [sites[0][2] for sites in g.geometry.readings]
    counts = np.array([float(len(sites)) for sites in g.geometry.readings])
    black = g("Unsqueeze", g("Mul", g("Gather", contract.BLACK, channels), counts), [1, 2])
    scale = g("Mul", g("Gather", contract.SCALE, channels), g("Gather", contract.GAMMA, channels))
    gain = g("Unsqueeze", g("Div", scale, g("Mul", g.unit, counts)), [1, 2])
    samples = g("Mul", g("Sub", samples, black), gain)
    return turn, g("Sub", columns, g.black), row_steps, column_steps, samples


def fill_holes(g: PatternGraph, probes: tuple[str, ...]) -> Blocks:
    """Luminance at the colour sites: a weighted mean of the interpolations along rows and along
    columns. probes: see `measure_blocks`.

    The weights are the inverse squared differences around the block, so that the direction with
    less change counts more. Where a stroke runs under a block, its samples do not add up to
    luminance: that tells more of it than the differences do.
    """
    turn, columns, *steps, samples = probes
    variance = g.variance(g("Slice", columns, [0], [1], [0]))  # at any site
    # what noise alone adds to a squared difference
    least = g("Add", g.still, g("Mul", variance, 2.0))
    row_change, column_change = (
        g("Add", g.mean(g("Mul", each, each), count, axis=0), least)
        for each, count in zip(steps, g.geometry.kinds[2:4], strict=True)
    )
    change = g("Add", row_change, column_change)
    along_rows = g("Div", column_change, change)
    filled = g("Add", columns, g("Mul", turn, along_rows))
    contrast = ""
    if g.geometry.scale == 1:
        contrast = g("Relu", g("Sub", g("Max", row_change, column_change), least))
    luminance = g.mean(filled, len(g.geometry.readings), axis=0)
    channels = [sites[0][2] for sites in g.geometry.readings]
    shares = np.array([1 / channels.count(channel) for channel in channels])[:, None, None]
    means = samples if (shares == 1).all() else g("Mul", samples, shares)
    gap = g("Sub", g.total(means, len(channels), axis=0), luminance)
    if g.geometry.pattern.derived is not None:  # Eq. 7 defines that channel, and tells nothing
        gap = g("Mul", gap, 0.0)
    gammas = g.total(g("Mul", g.gamma, g.gamma), g.channels, axis=0)
    noise = g("Mul", variance, g("Mul", gammas, _GAP_NOISE))
    apart = g("Mul", g("Relu", g("Sub", g("Mul", gap, gap), noise)), _GAP)
    return Blocks(samples, filled, luminance, gap, g("Add", change, apart), contrast)


def correct_luminance(g: PatternGraph, blocks: Blocks, ratios: str) -> str:
    """`filled` of the inner blocks, corrected by what the samples say, (sites, inner blocks).

    What chromaticity times luminance misses at the sites of a block is mapped to errors of
    luminance there (`shared.site_errors`), as far as it is more than noise, and as there is
    contrast: next to flat luminance it is an error of colour.
    """
    samples, filled, contrast = map(g.inner, (blocks.samples, blocks.filled, blocks.contrast))
    channels, count = [channel for _, _, channel in g.geometry.sites], len(g.geometry.sites)
    gamma = g("Gather", g.gamma, channels)
    residual = g("Sub", samples, g("Mul", g("Gather", ratios, channels), filled))
    power = g("Mul", g.total(g("Mul", residual, residual), count, axis=0), 1 / count)
    weight = g("Mul", g.total(g("Mul", gamma, gamma), count, axis=0), _RESIDUAL_NOISE / count)
    mean = g("Div", g.total(blocks.samples, count, axis=0), g.total(gamma, count, axis=0))
    noise = g("Mul", g.inner(g.variance(mean)), weight)
    contrast = g("Mul", contrast, _CONTRAST_ERROR)
    above = g("Mul", g("Relu", g("Sub", power, noise)), contrast)
    share = g("Div", above, g("Add", g("Mul", power, g("Add", contrast, power)), 1e-12))
    columns = g.geometry.luminance_errors.T[..., None, None]
    each_site = zip(g.split(residual, [1] * count, axis=0), columns, strict=True)
    errors = g.sum([g("Mul", *site) for site in each_site])
    return g("Add", filled, g("Mul", errors, share))


def fill_pixels(g: PatternGraph, filled: str) -> tuple[list[str], str]:
    """Luminance of every pixel, colour sites filled in: (1, 1, macropixels, patches) per pixel of a
    macropixel; and the mean of each macropixel.
    """
    period, across, side = g.geometry.pattern.period, g.geometry.across, g.geometry.macropixel
    # Space to depth, while samples have 2 bytes, in three steps for which onnxruntime has fast
    # code: separate rows, separate columns, then bring whole rows of patches into the order (pixels
    # of a macropixel, macropixels). One step would take ten times as long.
    codes = g("Unsqueeze", _patches(g), [1])
    codes = g("Transpose", g("Reshape", codes, [-1, period, 0]), perm=[1, 0, 2])
    codes = g("Transpose", g("Reshape", codes, [0, 0, -1, period]), perm=[0, 1, 3, 2])
    codes = g.reshape(codes, [across, side, g.patches[0], across, side, g.patches[1]])
    codes = g("Transpose", codes, perm=[1, 4, 0, 3, 2, 5])
    codes = g.reshape(codes, [side**2 * across**2, *g.patches])
    pixels = []
    for pixel, samples in enumerate(g.split(codes, [across**2] * side**2, axis=0)):
        luminance = g("Sub", g("Cast", samples, to=FLOAT), g.black)
        holes = [(site, hole) for site, hole in enumerate(g.geometry.holes) if hole.pixel == pixel]
        if holes:
            # A patch at (i, j) has its corners at the inner blocks i and i + 1.
            ends = {0: -1, 1: END}
            values = []
            for site, hole in holes:
                first = [site, hole.down, hole.right]
                stop = [site + 1, ends[hole.down], ends[hole.right]]
                values.append(g("Slice", filled, first, stop, [0, 1, 2]))
            places = np.array([[hole.macropixel] for _, hole in holes])
            luminance = g("ScatterND", luminance, places, g("Concat", *values, axis=0))
        pixels.append(luminance)
    return [g("Unsqueeze", plane, [0, 1]) for plane in pixels], g("Mul", g.sum(pixels), 1 / side**2)


def bin_pixels(g: PatternGraph) -> tuple[list[str], str]:
    """Luminance of every pixel of a smaller picture, the mean of its panchromatic samples; and the
    mean of each macropixel.

    The pixels are one tensor (pixels of a macropixel, 1, macropixels, patches), to be multiplied by
    the colour of the macropixels.
    """
    counts = g.geometry.pixels.sum(axis=(1, 2))[:, None, None]
    image, strides = g("Unsqueeze", _patches(g), [0, 1]), [g.geometry.pattern.period] * 2
    sums = g("Squeeze", g("Conv", image, g.geometry.pixels[:, None], strides=strides), [0])
    luminance = g("Sub", g("Mul", sums, 1 / counts), g.black)
    planes = g.split(luminance, [g.geometry.across**2] * g.geometry.within**2, axis=0)
    mean = planes[0] if len(planes) == 1 else g("Mul", g.sum(planes), 1 / len(planes))
    return [g.reshape(luminance, [len(planes), 1, g.geometry.across**2, *g.patches])], mean


def _patches(g: PatternGraph) -> str:
    """The samples of the patches, without those around them."""
    above, below, left, right = g.geometry.halo
    return g("Slice", contract.MOSAIC, [above, left], [-below, -right], [0, 1])
