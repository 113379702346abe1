"""The preview as an ONNX graph: mosaic -> luminance -> chromaticity -> propagation -> picture.

Needs `onnx`, but only to build a graph: a camera runs the files that `panchroma export-preview` has written with this module.

Until the last stage, light is measured in codes of a panchromatic sample above black. Tensors end with the axes (block rows, block
columns) or (patch rows, patch columns): the pixels at one place of all K x K patches form one plane (space to depth). Thus each
colour site is a plane, and no stage needs to find out the filter of a pixel.

Every operation rounds once, as IEEE 754 prescribes, and the order of every sum is either irrelevant or fixed in the graph, so that
all processors give the same bytes. This rules out the operators for reciprocals, powers, exponentials and reductions, and allows
convolutions only for exact sums (`measure_blocks`, `mean_light`) and for the colour matrix (`device.preview.picture`).
"""

import numpy as np
import onnx

from shared.display import SATURATED
from shared.pattern import CfaPattern

from . import contract
from .geometry import REACH, Geometry
from .nodes import END, FLOAT, UINT8, UINT16, Nodes, Shape
from .picture import burnt_out, display, in_picture_units, interleave

BUILDER = "5"
"""Version of this module, stored in the graph; increase it whenever the bytes of a graph change."""

_FLOOR = 1e-3
"""Least luminance of a block, scene units; keeps ratios to it finite."""
_STILL = 1e-4
"""Mean squared difference, (scene units)^2, below which rows and columns have equal weight."""
_LEAST_VARIANCE = 1e-6
"""Least noise variance in Eqs. 8-9, codes^2; makes a block without light grey and changes no other."""
# How blocks are pooled: chosen on seven test photographs with seven others in view (both gain), with 95 % of the colour of strokes
# 36 pixels wide kept at sigma 0.03, and no photograph worse without noise.
_PRIOR = 0.5
"""Multiple of the noise variance in Eqs. 8-9, which pulls a dark block towards grey."""
_POOLING = 3e-4
"""Squared ratio of error to signal of a block at which half of its chromaticity comes from the blocks around it."""
_MISREAD = 2e-4
"""The change of luminance around a block times this is the variance of what the block misreads, in addition to noise."""
_ALIKE = 0.15
"""Squared relative difference of colour at which the weight of a block in the pooling of another is a quarter."""
_ALIKE_NOISE = 24.0
"""Multiple of the noise variance that a squared difference of colour must exceed to count in pooling."""
_CONTRAST = 0.1
"""Squared relative difference of luminance at which the weight of a block is halved."""
_NOISE_WEIGHT = 4.0
"""Multiple of the noise variance that a squared relative difference must exceed to count."""
_MISSED_NOISE = 2.0
"""Multiple of the noise variance that the mean square of what is missed at the sites of a block must exceed to count."""
_DOUBT = 0.5
"""Squared contrast times this is the power of what is missed at which half of it counts as an error of luminance."""
_SPREAD = 0.5
"""Power of the bilinear weights. Below 1 the four blocks share more evenly: less noise, still no step between patches."""


def build_preview(pattern: CfaPattern, scale: int = 1, *, linear: bool = False) -> onnx.ModelProto:
    """Build the graph for all mosaics of a pattern; `device.preview.contract` describes its inputs and outputs.

    pattern: the filter pattern; its origin does not matter.
    scale: sensor pixels per picture pixel, each way; one of `Geometry.scales(pattern)`.
    linear: camera RGB in scene units instead of a picture for a screen.
    The bytes are always the same. Raises InputError for any other scale.
    """
    geometry = Geometry(pattern, scale)
    g = Nodes()
    inputs = Inputs(g, geometry)
    probes = measure_blocks(g, geometry, inputs)
    filled, luminance, change, contrast = fill_holes(g, geometry, inputs, probes)
    parts = estimate_parts(g, geometry, inputs, probes, filled, luminance)  # Eqs. 8-9
    pooled, light, limit = pool(g, inputs, parts, luminance, change)
    colour = in_picture_units(g, inputs.unit, pooled, "" if linear else contract.WHITE)
    if scale == 1:
        settled = settle(g, geometry, inputs, probes, filled, pooled, contrast)
        pixels, cells = pixel_light(g, geometry, inputs, settled)
    else:
        pixels, cells = mean_light(g, geometry, inputs, *probes[5:])
    shown = "" if linear else burnt_out(g, inputs.full_scale, cells)
    spread = propagate(g, geometry, light, limit, colour, cells, shown)  # Eq. 10
    camera = [g("Mul", each, spread) for each in pixels]  # Eq. 17
    picture = interleave(g, geometry, inputs.patches, camera if linear else [display(g, each) for each in camera], linear=linear)
    return finish(g, geometry, picture, linear=linear)


class Inputs:
    """The inputs of the graph, converted to its own units, and the size of the frame in patches."""

    def __init__(self, g: Nodes, geometry: Geometry) -> None:
        period, channels = geometry.pattern.period, len(geometry.pattern.channels)
        above, below, left, right = geometry.halo
        lengths = (
            g("Sub", g("Shape", contract.MOSAIC, start=axis, end=axis + 1), [halo])
            for axis, halo in enumerate((above + below, left + right))
        )
        self.patches = [g("Div", length, [period]) for length in lengths]  # (rows, columns)
        self.channels = channels
        self.gamma = g("Unsqueeze", contract.GAMMA, [1, 2])
        self.black = g("Slice", contract.BLACK, [channels], [channels + 1])
        self.unit = g("Slice", contract.SCALE, [channels], [channels + 1])  # scene units per code
        square = g("Mul", self.unit, self.unit)
        self.full_scale = g("Div", g.total(self.gamma, channels, axis=0), self.unit)
        self.floor, self.still = g("Div", _FLOOR, self.unit), g("Div", _STILL, square)
        shot, read_variance = g.split(contract.NOISE, (1, 1), axis=0)
        self._shot, self._read_variance = g("Div", shot, self.unit), g("Div", read_variance, square)

    def variance(self, g: Nodes, luminance: str) -> str:
        """Noise variance sigma_z^2 of a panchromatic sample, codes^2."""
        return g("Add", g("Mul", g("Relu", luminance), self._shot), self._read_variance)


def measure_blocks(g: Nodes, geometry: Geometry, inputs: Inputs) -> list[str]:
    """The probes of every block, a tensor (n, blocks) per kind.

    The first kind is what interpolation along rows reads more than that along columns, which is the second. Colour samples are
    converted to panchromatic codes above black, times gamma: what luminance has from a channel. Sums of pixels stay as read.
    """
    period, weights, count = geometry.pattern.period, geometry.probes.copy(), len(geometry.readings)
    weights[:count] -= weights[count : 2 * count]
    image = g("Unsqueeze", g("Cast", contract.MOSAIC, to=FLOAT), [0, 1])
    probes = g("Squeeze", g("Conv", image, weights[:, None], strides=[period, period]), [0])
    turn, columns, row_steps, column_steps, samples, *pixels = g.split(probes, geometry.kinds, axis=0)
    channels = [sites[0][2] for sites in geometry.readings]
    counts = np.array([float(len(sites)) for sites in geometry.readings])
    black = g("Unsqueeze", g("Mul", g("Gather", contract.BLACK, channels), counts), [1, 2])
    scale = g("Mul", g("Gather", contract.SCALE, channels), g("Gather", contract.GAMMA, channels))
    gain = g("Unsqueeze", g("Div", scale, g("Mul", inputs.unit, counts)), [1, 2])
    samples = g("Mul", g("Sub", samples, black), gain)
    return [turn, g("Sub", columns, inputs.black), row_steps, column_steps, samples, *pixels]


def fill_holes(g: Nodes, geometry: Geometry, inputs: Inputs, probes: list[str]) -> tuple[str, str, str, str]:
    """Luminance at the colour sites of every block, (sites, blocks), and its mean, change and contrast, each (1, blocks).

    It is a weighted mean of the interpolations along rows and along columns. The weights are the inverse squared differences around
    the block, so that the direction with less change counts more. Change is the sum of these squared differences; contrast, which
    only a full picture needs, is the larger of them beyond the noise.
    """
    turn, columns, *steps = probes[:4]
    variance = inputs.variance(g, g("Slice", columns, [0], [1], [0]))  # at any site
    least = g("Add", inputs.still, g("Mul", variance, 2.0))  # what noise alone adds to a squared difference
    row_change, column_change = (
        g("Add", g.mean(g("Mul", each, each), count, axis=0), least) for each, count in zip(steps, geometry.kinds[2:4], strict=True)
    )
    change = g("Add", row_change, column_change)
    along_rows = g("Div", column_change, change)
    filled = g("Add", columns, g("Mul", turn, along_rows))
    contrast = g("Relu", g("Sub", g("Max", row_change, column_change), least)) if geometry.scale == 1 else ""
    return filled, g.mean(filled, len(geometry.readings), axis=0), change, contrast


def estimate_parts(g: Nodes, geometry: Geometry, inputs: Inputs, probes: list[str], filled: str, luminance: str) -> str:
    """The part gamma_j c_j of every channel in the luminance of every block, (C, blocks).

    The chromaticities c_j are the exact minimiser of Eqs. 8-9 under sum_i gamma_i c_i = 1, so that the parts add up to 1. Where
    panchromatic samples are saturated, those of the block say how much light there is (Eq. 7): with less, white would be yellow.
    """
    channels = [sites[0][2] for sites in geometry.readings]
    counts = [channels.count(channel) for channel in range(inputs.channels)]
    first, last = SATURATED
    shares = np.array([1 / counts[channel] for channel in channels])[:, None, None]
    known = g.total(g("Mul", probes[4], shares), len(channels), axis=0)
    above = g("Add", g("Mul", luminance, g("Div", 1 / (last - first), inputs.full_scale)), -first / (last - first))
    filled = g("Add", filled, g("Mul", g("Relu", g("Sub", known, luminance)), g("Clip", above, 0.0, 1.0)))

    def of_channels(products: str) -> str:
        if set(counts) == {1}:
            return products
        parts = g.split(products, counts, axis=0)
        return g("Concat", *(g.total(part, count, axis=0) for part, count in zip(parts, counts, strict=True)), axis=0)

    variance = g("Max", g("Mul", inputs.variance(g, luminance), _PRIOR), _LEAST_VARIANCE)
    grey = g("Div", inputs.gamma, g.total(inputs.gamma, inputs.channels, axis=0))
    a = g("Add", of_channels(g("Mul", filled, filled)), variance)
    parts = g("Div", g("Add", of_channels(g("Mul", filled, probes[4])), g("Mul", variance, grey)), a)
    pull = g("Div", g("Mul", inputs.gamma, inputs.gamma), a)
    missing = g("Sub", 1.0, g.total(parts, inputs.channels, axis=0))
    return g("Add", parts, g("Mul", pull, g("Div", missing, g.total(pull, inputs.channels, axis=0))))


def pool(g: Nodes, inputs: Inputs, parts: str, luminance: str, change: str) -> tuple[str, str, str]:
    """`parts` of the inner blocks, (C, inner blocks), and what weighs a block in `propagate`, each (1, inner blocks).

    That is luminance, and the squared difference from it at which the weight is halved.

    The larger the error of a block, by noise and beside edges, the more its colour becomes the mean of the 3 x 5 blocks around it:
    of the blocks above and below, then twice of those on the left and right, each as far as it is alike (a separated bilateral
    filter, Pham and van Vliet 2005). So ink keeps its colour next to paper, which has more light.
    """
    variance = inputs.variance(g, luminance)
    light = g("Max", luminance, inputs.floor)
    power = g("Mul", light, light)
    colours = g("Mul", parts, light)  # of two blocks that are alike the lighter one knows more
    alike = g("Add", g("Mul", power, _ALIKE), g("Mul", variance, _ALIKE_NOISE))
    mean = with_neighbours(g, colours, similarity(g, inputs, colours, alike, 1), 1)
    similar = g("Slice", similarity(g, inputs, colours, alike, 2), [1], [-1], [1])
    mean = with_neighbours(g, mean, similar, 2)
    mean = with_neighbours(g, mean, g("Slice", similar, [1], [-1], [2]), 2)
    own, light, power, variance, change = (inner(g, each) for each in (colours, light, power, variance, change))
    doubt = g("Add", variance, g("Mul", change, _MISREAD))
    pooled = g("Add", g("Mul", own, g("Mul", power, _POOLING)), g("Mul", mean, doubt))
    limit = g("Add", g("Mul", power, _CONTRAST), g("Mul", variance, _NOISE_WEIGHT))
    return g("Div", pooled, g.total(pooled, inputs.channels, axis=0)), light, limit


def similarity(g: Nodes, inputs: Inputs, colours: str, alike: str, axis: int) -> str:
    """How much each two neighbouring blocks along an axis are alike, 0 to 1: (1, blocks), of each block and the next one.

    colours: light of every channel, codes, (C, blocks).
    alike: squared difference of two colours that still counts little, codes^2, (1, blocks).
    """
    (here, limit), (there, other) = (
        [g("Slice", each, [first], [last], [axis]) for each in (colours, alike)] for first, last in ((0, -1), (1, END))
    )
    apart, limit = g("Sub", here, there), g("Min", limit, other)
    part = g("Div", limit, g("Add", limit, g.total(g("Mul", apart, apart), inputs.channels, axis=0)))
    return g("Mul", part, part)


def with_neighbours(g: Nodes, values: str, similar: str, axis: int) -> str:
    """Values of all but the outermost blocks along an axis, plus those of both neighbours as far as they are alike."""
    own, before, after = (g("Slice", values, [first], [last], [axis]) for first, last in ((1, -1), (0, -2), (2, END)))
    like_before, like_after = (g("Slice", similar, [first], [last], [axis]) for first, last in ((0, -1), (1, END)))
    return g("Add", own, g("Add", g("Mul", before, like_before), g("Mul", after, like_after)))


def inner(g: Nodes, values: str) -> str:
    """Values of the inner blocks, those at the corners of the patches, out of values of all blocks that are read."""
    return g("Slice", values, list(REACH), [-blocks for blocks in REACH], [1, 2])


def settle(g: Nodes, geometry: Geometry, inputs: Inputs, probes: list[str], filled: str, parts: str, contrast: str) -> str:
    """`filled` of the inner blocks, corrected by what the samples say, (sites, inner blocks).

    What chromaticity times luminance misses at the sites of a block is mapped to errors of luminance there (`shared.site_errors`),
    as far as it is more than noise, and as there is contrast: next to flat luminance it is an error of colour.
    """
    samples, filled, contrast = (inner(g, each) for each in (probes[4], filled, contrast))
    channels, count = [channel for _, _, channel in geometry.sites], len(geometry.sites)
    gamma = g("Gather", inputs.gamma, channels)
    missed = g("Sub", samples, g("Mul", g("Gather", parts, channels), filled))
    power = g("Mul", g.total(g("Mul", missed, missed), count, axis=0), 1 / count)
    weight = g("Mul", g.total(g("Mul", gamma, gamma), count, axis=0), _MISSED_NOISE / count)
    mean = g("Div", g.total(samples, count, axis=0), g.total(gamma, count, axis=0))
    noise = g("Mul", inputs.variance(g, mean), weight)
    contrast = g("Mul", contrast, _DOUBT)
    share = g(
        "Div", g("Mul", g("Relu", g("Sub", power, noise)), contrast), g("Add", g("Mul", power, g("Add", contrast, power)), 1e-12)
    )
    columns = geometry.settling.T[..., None, None]
    errors = g.sum([g("Mul", *each) for each in zip(g.split(missed, [1] * count, axis=0), columns, strict=True)])
    return g("Add", filled, g("Mul", errors, share))


def pixel_light(g: Nodes, geometry: Geometry, inputs: Inputs, filled: str) -> tuple[list[str], str]:
    """Luminance of every pixel, colour sites filled in: (1, 1, cells, patches) per pixel of a cell; and the mean of each cell."""
    period, across, cell = geometry.pattern.period, geometry.across, geometry.cell
    above, below, left, right = geometry.halo
    # Space to depth, while samples have 2 bytes, in three steps for which onnxruntime has fast code: separate rows, separate
    # columns, then bring whole rows of patches into the order (pixels of a cell, cells). One step would take ten times as long.
    codes = g("Unsqueeze", g("Slice", contract.MOSAIC, [above, left], [-below, -right], [0, 1]), [1])
    codes = g("Transpose", g("Reshape", codes, [-1, period, 0]), perm=[1, 0, 2])
    codes = g("Transpose", g("Reshape", codes, [0, 0, -1, period]), perm=[0, 1, 3, 2])
    codes = g.reshape(codes, [across, cell, inputs.patches[0], across, cell, inputs.patches[1]])
    codes = g.reshape(g("Transpose", codes, perm=[1, 4, 0, 3, 2, 5]), [cell**2 * across**2, *inputs.patches])
    pixels = []
    for pixel, part in enumerate(g.split(codes, [across**2] * cell**2, axis=0)):
        light = g("Sub", g("Cast", part, to=FLOAT), inputs.black)
        holes = [(site, hole) for site, hole in enumerate(geometry.holes) if hole.pixel == pixel]
        if holes:
            # A patch at (i, j) has its corners at the inner blocks i and i + 1.
            ends = {0: -1, 1: END}
            values = [
                g("Slice", filled, [site, hole.down, hole.right], [site + 1, ends[hole.down], ends[hole.right]], [0, 1, 2])
                for site, hole in holes
            ]
            light = g("ScatterND", light, np.array([[hole.cell] for _, hole in holes]), g("Concat", *values, axis=0))
        pixels.append(light)
    return [g("Unsqueeze", light, [0, 1]) for light in pixels], g("Mul", g.sum(pixels), 1 / cell**2)


def mean_light(g: Nodes, geometry: Geometry, inputs: Inputs, measured: str = "") -> tuple[list[str], str]:
    """Luminance of every pixel of a smaller picture, the mean of its panchromatic samples; and the mean of each cell.

    measured: the sums of the pixels, (pixels, blocks), if probes have measured them.
    The pixels are one tensor (pixels of a cell, 1, cells, patches), to be multiplied by the colour of the cells.
    """
    counts = geometry.pixels.sum(axis=(1, 2))[:, None, None]
    if measured:
        # Around the blocks at the corners of the patches there are more on each side, see `Geometry.halo`.
        means = g("Sub", g("Mul", measured, 1 / counts), inputs.black)
        rows, columns = REACH
        places = [(pixel, *geometry.corner(pixel)) for pixel in range(len(geometry.pixels))]
        parts = [
            g("Slice", means, [n, rows + i, columns + j], [n + 1, i - 1 - rows, j - 1 - columns], [0, 1, 2]) for n, i, j in places
        ]
        light = g("Concat", *parts, axis=0)
    else:
        above, below, left, right = geometry.halo
        codes = g("Slice", contract.MOSAIC, [above, left], [-below, -right], [0, 1])
        image = g("Unsqueeze", g("Cast", codes, to=FLOAT), [0, 1])
        sums = g("Squeeze", g("Conv", image, geometry.pixels[:, None], strides=[geometry.pattern.period] * 2), [0])
        light = g("Sub", g("Mul", sums, 1 / counts), inputs.black)
        parts = g.split(light, [geometry.across**2] * geometry.within**2, axis=0)
    mean = parts[0] if len(parts) == 1 else g("Mul", g.sum(parts), 1 / len(parts))
    return [g.reshape(light, [len(parts), 1, geometry.across**2, *inputs.patches])], mean


def propagate(g: Nodes, geometry: Geometry, light: str, limit: str, colour: str, cells: str, shown: str) -> str:
    """Colour of every cell, (C, cells, patches): a convex combination of those of the four blocks at the corners of its patch.

    The weight of a block falls with its distance, and with the squared difference between its luminance `light` and that of the
    cell: where this is `limit`, the weight is halved. The result is divided by `shown`, if there is any (see `burnt_out`).
    """
    place = (np.arange(geometry.across) + 0.5) / geometry.across
    weights, mixed = [], []
    for down in (0, 1):
        for right in (0, 1):
            near = np.outer(place if down else 1 - place, place if right else 1 - place) ** _SPREAD
            ends = [END if down else -1, END if right else -1]
            level, most, block = (g("Slice", each, [down, right], ends, [1, 2]) for each in (light, limit, colour))
            apart = g("Sub", cells, level)
            weight = g("Div", most, g("Add", g("Mul", apart, apart), most))
            weights.append(weight if geometry.across == 1 else g("Mul", weight, near.reshape(-1, 1, 1)))
            mixed.append(g("Mul", weights[-1], g("Unsqueeze", block, [1])))
    total = g.sum(weights)
    return g("Div", g.sum(mixed), g("Mul", total, shown) if shown else total)


def finish(g: Nodes, geometry: Geometry, picture: str, *, linear: bool) -> onnx.ModelProto:
    """The finished model, with the metadata that the runtime needs."""
    channels = len(geometry.pattern.channels)
    inputs: dict[str, tuple[int, Shape]] = {
        contract.MOSAIC: (UINT16, ["rows", "columns"]),
        contract.BLACK: (FLOAT, [channels + 1]),
        contract.SCALE: (FLOAT, [channels + 1]),
        contract.GAMMA: (FLOAT, [channels]),
        contract.NOISE: (FLOAT, [2]),
    }
    if not linear:
        inputs |= {contract.WHITE: (FLOAT, [channels]), contract.MATRIX: (FLOAT, [3, channels])}
    kind: tuple[int, Shape] = (FLOAT, ["height", "width", channels]) if linear else (UINT8, ["height", "width", 3])
    description = contract.Description(
        tile=contract.tile_name(geometry.pattern),
        channels=geometry.pattern.channels,
        scale=geometry.scale,
        linear=linear,
        halo=geometry.halo,
        builder=BUILDER,
    )
    return g.finish(picture, inputs, kind, description)
