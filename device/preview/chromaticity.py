"""Chromaticity in a preview graph: of every block (Eqs. 8-9), pooled with those around it, and
spread over the macropixels (Eq. 10).
"""

import numpy as np

from ...shared.display import SATURATED
from .luminance import Blocks
from .nodes import END
from .pattern_graph import PatternGraph

_LEAST_VARIANCE = 1e-6
"""Least noise variance in Eqs. 8-9, codes^2; makes a block without light grey and changes no
other.
"""
# How blocks are pooled: chosen on test photographs and on black print, whose tint at K = 6 is at
# most 0.09 in 99.9 % of the pixels, with 95 % of the colour of strokes 36 pixels wide kept at sigma
# 0.03.
_PRIOR = 0.5
"""Multiple of the noise variance in Eqs. 8-9, which pulls a dark block towards grey."""
_STROKES_PRIOR = 0.01
"""Multiple of the change of luminance around a block, beyond its noise, that likewise pulls it
towards grey: its sites lie beside a stroke, or on it. Five times as much would leave half of the
false colours of thin bright strokes, but take colour from ink.
"""
_POOLING = 3e-4
"""Squared ratio of error to signal of a block at which half of its chromaticity comes from the
blocks around it.
"""
_MISREAD = 1.4e-3
"""The change of luminance around a block times this is the variance of what the block misreads, in
addition to noise.
"""
_ALIKE = 0.13
"""Squared relative difference of colour at which the weight of a block in the pooling of another is
a quarter.
"""
_ALIKE_NOISE = 24.0
"""Multiple of the noise variance that a squared difference of colour must exceed to count in
pooling.
"""
_ALIKE_STROKES = 0.15
"""Multiple of the change of luminance around a block, beyond its noise, that likewise has to be
exceeded.
"""
_STROKES = 8.0
"""Squared relative change of luminance around a block times this, plus 1, is what its colour counts
less by in that of others.
"""
_CONTRAST = 0.1
"""Squared relative difference of luminance at which the weight of a block is halved."""
_CONTRAST_STROKES = 0.5
"""Squared relative change of luminance around a block times this, plus 1, is what that difference
is divided by.
"""
_NOISE_WEIGHT = 4.0
"""Multiple of the noise variance that a squared relative difference must exceed to count."""
_SPREAD = 0.5
"""Power of the bilinear weights. Below 1 the four blocks share more evenly: less noise, still no
step between patches.
"""


def estimate_ratios(g: PatternGraph, blocks: Blocks) -> str:
    """The ratio gamma_j c_j of every channel to the luminance of every block, (C, blocks).

    The chromaticities c_j are the exact minimiser of Eqs. 8-9 under sum_i gamma_i c_i = 1, so that
    the ratios add up to 1. Where panchromatic samples are saturated, those of the block say how
    much light there is (Eq. 7): with less, white would be yellow. Where a channel has no sites they
    do not say it: blocks beside a saturated sample are grey.
    """
    samples, filled, luminance, gap, *_ = blocks
    channels = [sites[0][2] for sites in g.geometry.readings]
    derived = g.geometry.pattern.derived
    counts = [channels.count(channel) for channel in range(g.channels) if channel != derived]
    first, last = SATURATED

    def above(level: str) -> str:
        slope = g("Div", 1 / (last - first), g.full_scale)
        return g("Add", g("Mul", level, slope), -first / (last - first))

    # A block may be dark on the mean, and its samples lie beside saturated ones.
    beyond = g("Clip", above(g("Max", *g.split(filled, [1] * len(channels), axis=0))), 0.0, 1.0)
    filled = g("Add", filled, g("Mul", g("Relu", gap), beyond))

    def of_channels(products: str) -> str:
        if counts == [1] * g.channels:
            return products
        groups = zip(g.split(products, counts, axis=0), counts, strict=True)
        ratios = [g.total(product, count, axis=0) for product, count in groups]
        if derived is not None:  # no sample: the constraint alone decides
            ratios.insert(derived, g("Mul", ratios[0], 0.0))
        return g("Concat", *ratios, axis=0)

    variance = g("Max", g("Mul", g.variance(luminance), _PRIOR), _LEAST_VARIANCE)
    misread = g("Mul", strokes_around(g, blocks), g("Sub", 1.0, beyond))
    variance = g("Add", variance, g("Mul", misread, _STROKES_PRIOR))
    grey = g("Div", g.gamma, g.total(g.gamma, g.channels, axis=0))
    a = g("Add", of_channels(g("Mul", filled, filled)), variance)
    ratios = g("Div", g("Add", of_channels(g("Mul", filled, samples)), g("Mul", variance, grey)), a)
    pull = g("Div", g("Mul", g.gamma, g.gamma), a)
    missing = g("Sub", 1.0, g.total(ratios, g.channels, axis=0))
    ratios = g("Add", ratios, g("Mul", pull, g("Div", missing, g.total(pull, g.channels, axis=0))))
    if derived is None:
        return ratios
    # No sample bounds that channel: bright sites in the dark, or in light that saturates
    # panchromatic pixels, would make it negative.
    ratios = g("Relu", ratios)
    ratios = g("Div", ratios, g.total(ratios, g.channels, axis=0))
    return g("Add", ratios, g("Mul", beyond, g("Sub", grey, ratios)))


def strokes_around(g: PatternGraph, blocks: Blocks) -> str:
    """The change of luminance around each block beyond what noise alone makes of it (see
    `fill_holes`), codes^2, (1, blocks).
    """
    by_noise = g("Mul", g("Add", g.still, g("Mul", g.variance(blocks.luminance), 2.0)), 2.0)
    return g("Relu", g("Sub", blocks.change, by_noise))


def pool(g: PatternGraph, ratios: str, blocks: Blocks) -> tuple[str, str, str]:
    """`ratios` of the inner blocks, each pooled with those around it.

    The larger the error of a block, by noise and beside edges, the more its colour becomes the mean
    of the 3 x 5 blocks around it: of the blocks above and below, then twice of those on the left
    and right, each as far as it is alike (a separated bilateral filter, Pham and van Vliet 2005).
    So ink keeps its colour next to paper, which has more light. The more luminance changes around a
    block, the less it is known: it is like others sooner, and counts less, for them and for pixels
    (`propagate`). So black print stays grey, and ink shows the colour of the blocks that lie within
    it.

    Returns
    -------
    tuple[str, str, str]
        The ratios, (C, inner blocks). What weighs a block in `propagate`, (1, inner blocks): its
        luminance, and the squared difference from it at which the weight is halved.
    """
    variance = g.variance(blocks.luminance)
    luminance = g("Max", blocks.luminance, g.floor)
    power = g("Mul", luminance, luminance)
    colours = g("Mul", ratios, luminance)  # of two similar blocks the brighter one has less noise
    strokes = strokes_around(g, blocks)
    alike = g("Add", g("Mul", power, _ALIKE), g("Mul", variance, _ALIKE_NOISE))
    alike = g("Add", alike, g("Mul", strokes, _ALIKE_STROKES))
    sure = g("Div", power, g("Add", power, g("Mul", strokes, _STROKES)))
    mean = with_neighbours(g, g("Mul", colours, sure), similarity(g, colours, alike, 1), 1)
    similar = g("Slice", similarity(g, colours, alike, 2), [1], [-1], [1])
    mean = with_neighbours(g, mean, similar, 2)
    mean = with_neighbours(g, mean, g("Slice", similar, [1], [-1], [2]), 2)
    planes = colours, luminance, power, variance, blocks.change, strokes
    own, luminance, power, variance, change, strokes = map(g.inner, planes)
    misread = g("Add", variance, g("Mul", change, _MISREAD))
    pooled = g("Add", g("Mul", own, g("Mul", power, _POOLING)), g("Mul", mean, misread))
    limit = g("Add", g("Mul", power, _CONTRAST), g("Mul", variance, _NOISE_WEIGHT))
    limit = g("Mul", limit, g("Div", power, g("Add", power, g("Mul", strokes, _CONTRAST_STROKES))))
    return g("Div", pooled, g.total(pooled, g.channels, axis=0)), luminance, limit


def similarity(g: PatternGraph, colours: str, alike: str, axis: int) -> str:
    """Similarity of each two neighbouring blocks along an axis, 0 to 1: (1, blocks), of each block
    and the next one.

    Parameters
    ----------
    colours : str
        Light of every channel, codes, (C, blocks).
    alike : str
        Squared difference of two colours that still counts little, codes^2, (1, blocks).
    """
    (here, limit), (there, other) = (
        [g("Slice", plane, [first], [last], [axis]) for plane in (colours, alike)]
        for first, last in ((0, -1), (1, END))
    )
    apart, limit = g("Sub", here, there), g("Min", limit, other)
    ratio = g("Div", limit, g("Add", limit, g.total(g("Mul", apart, apart), g.channels, axis=0)))
    return g("Mul", ratio, ratio)


def with_neighbours(g: PatternGraph, values: str, similar: str, axis: int) -> str:
    """Values of all but the outermost blocks along an axis, plus those of both neighbours as far as
    they are alike.
    """
    own, before, after = g.cut(values, axis, (1, -1), (0, -2), (2, END))
    like_before, like_after = g.cut(similar, axis, (0, -1), (1, END))
    return g("Add", own, g("Add", g("Mul", before, like_before), g("Mul", after, like_after)))


def propagate(
    g: PatternGraph, colour: str, luminance: str, limit: str, coarse: str, shown: str
) -> str:
    """Colour of every macropixel, (C, macropixels, patches): a convex combination of those of the
    four blocks at the corners of its patch.

    The weight of a block falls with its distance, and with the squared difference between its
    luminance and that of the macropixel.

    Parameters
    ----------
    colour : str
        The ratios of the inner blocks in the units of the picture.
    luminance, limit : str
        See `pool`.
    coarse : str
        Mean luminance of each macropixel, (1, macropixels, patches).
    shown : str
        What the result is divided by, see `burnt_out`; "" = nothing.
    """
    place = (np.arange(g.geometry.across) + 0.5) / g.geometry.across
    planes, weights, mixed = (luminance, limit, colour), [], []
    for down in (0, 1):
        for right in (0, 1):
            near = np.outer(place if down else 1 - place, place if right else 1 - place) ** _SPREAD
            ends = [END if down else -1, END if right else -1]
            level, most, block = (g("Slice", one, [down, right], ends, [1, 2]) for one in planes)
            apart = g("Sub", coarse, level)
            weight = g("Div", most, g("Add", g("Mul", apart, apart), most))
            weights.append(
                weight if g.geometry.across == 1 else g("Mul", weight, near.reshape(-1, 1, 1))
            )
            mixed.append(g("Mul", weights[-1], g("Unsqueeze", block, [1])))
    total = g.sum(weights)
    return g("Div", g.sum(mixed), g("Mul", total, shown) if shown else total)
