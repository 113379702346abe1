"""The preview as an ONNX graph: mosaic -> luminance -> chromaticity -> propagation -> picture.

Needs `onnx`, but only to build a graph: a camera runs the files that `panchroma export-preview` has written with this module.

Until the last stage, light is measured in codes of a panchromatic sample above black. Tensors end with the axes (block rows, block
columns) or (patch rows, patch columns): the pixels at one place of all K x K patches form one plane (space to depth). Thus each
colour site is a plane, and no stage needs to find out the filter of a pixel.

Every operation rounds once, as IEEE 754 prescribes, and the order of every sum is either irrelevant or fixed in the graph, so that
all processors give the same bytes. This rules out the operators for reciprocals, powers, exponentials and reductions, and allows
convolutions only for exact sums (`measure_blocks`, `mean_light`) and for the colour matrix (`display`).
"""

import numpy as np
import onnx

from shared.display import SATURATED
from shared.pattern import CfaPattern

from . import contract
from .geometry import Geometry
from .nodes import END, FLOAT, UINT8, UINT16, Nodes, Shape

BUILDER = "5"
"""Version of this module, stored in the graph; increase it whenever the bytes of a graph change."""

_FLOOR = 1e-3
"""Least luminance of a block, scene units; keeps ratios to it finite."""
_STILL = 1e-4
"""Mean squared difference, (scene units)^2, below which rows and columns have equal weight."""
_LEAST_VARIANCE = 1e-6
"""Least noise variance in Eqs. 8-9, codes^2; makes a block without light grey and changes no other."""
_POOLING = 3e-4
"""Squared noise-to-signal ratio of a block at which half of its chromaticity comes from the blocks around it."""
_CONTRAST = 0.1
"""Squared relative difference of luminance at which the weight of a block is halved."""
_NOISE_WEIGHT = 4.0
"""Multiple of the noise variance that a squared relative difference must exceed to count."""
_MISSED_NOISE = 2.0
"""Multiple of the noise variance that the mean square of what is missed at the sites of a block must exceed to count."""
_DOUBT = 0.5
"""Squared contrast times this is the power of what is missed at which half of it counts as an error of luminance."""
_BURNT = 10.0
"""Multiple of the luminance of saturated pixels that is shown: white where every channel has a tenth of what white has."""
_SPREAD = 0.5
"""Power of the bilinear weights. Below 1 the four blocks share more evenly: less noise, still no step between patches."""

# The curve of IEC 61966-2-1 without a power: OFFSET + GAIN (s - BEND / (s + KNEE)), s = sqrt(x + SHIFT), in codes of 8 bits.
# Fitted: its error is at most 0.62 codes, 0.28 on average, and 0 at black and white.
_SHIFT, _OFFSET, _GAIN, _BEND, _KNEE = 0.0025, 47, 220.4931078, 0.06618546, 0.2


def build_preview(pattern: CfaPattern, scale: int = 1, *, linear: bool = False) -> onnx.ModelProto:
    """Build the graph for all mosaics of a pattern; `device.contract` describes its inputs and outputs.

    pattern: the filter pattern; its origin does not matter.
    scale: sensor pixels per picture pixel, each way; one of `Geometry.scales(pattern)`.
    linear: camera RGB in scene units instead of a picture for a screen.
    The bytes are always the same. Raises InputError for any other scale.
    """
    geometry = Geometry(pattern, scale)
    g = Nodes()
    inputs = Inputs(g, geometry)
    probes = measure_blocks(g, geometry, inputs)
    filled, luminance, contrast = fill_holes(g, geometry, inputs, probes)
    chromaticity = estimate_chromaticities(g, geometry, inputs, probes, filled, luminance)  # Eqs. 8-9
    pooled, measures = pool(g, inputs, chromaticity, luminance)
    blocks = g("Concat", measures, in_picture_units(g, inputs, pooled, "" if linear else contract.WHITE), axis=0)
    if scale == 1:
        settled = settle(g, geometry, inputs, probes, filled, pooled, contrast)
        pixels, cells = pixel_light(g, geometry, inputs, settled)
    else:
        pixels, cells = mean_light(g, geometry, inputs, *probes[5:])
    spread = propagate(g, geometry, blocks, cells)  # Eq. 10
    shown = pixels if linear else [burnt_out(g, inputs, light) for light in pixels]
    camera = [g("Mul", light, spread) for light in shown]  # Eq. 17
    picture = interleave(g, geometry, inputs, camera if linear else [display(g, each) for each in camera], linear=linear)
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
        self.floor, self.still = g("Div", _FLOOR, self.unit), g("Div", _STILL, square)
        shot, read_variance = g.split(contract.NOISE, (1, 1), axis=0)
        self._shot, self._read_variance = g("Div", shot, self.unit), g("Div", read_variance, square)

    def variance(self, g: Nodes, luminance: str) -> str:
        """Noise variance sigma_z^2 of a panchromatic sample, codes^2."""
        return g("Add", g("Mul", g("Relu", luminance), self._shot), self._read_variance)


def measure_blocks(g: Nodes, geometry: Geometry, inputs: Inputs) -> list[str]:
    """The probes of every block, a tensor (n, blocks) per kind.

    Colour samples are converted to panchromatic codes; the sums of pixels stay as read.
    """
    period = geometry.pattern.period
    image = g("Unsqueeze", g("Cast", contract.MOSAIC, to=FLOAT), [0, 1])
    probes = g("Squeeze", g("Conv", image, geometry.probes[:, None], strides=[period, period]), [0])
    rows, columns, row_steps, column_steps, samples, *pixels = g.split(probes, geometry.kinds, axis=0)
    channels = [sites[0][2] for sites in geometry.readings]
    counts = np.array([float(len(sites)) for sites in geometry.readings])
    black = g("Unsqueeze", g("Mul", g("Gather", contract.BLACK, channels), counts), [1, 2])
    gain = g("Unsqueeze", g("Div", g("Gather", contract.SCALE, channels), g("Mul", inputs.unit, counts)), [1, 2])
    samples = g("Mul", g("Sub", samples, black), gain)
    return [g("Sub", rows, inputs.black), g("Sub", columns, inputs.black), row_steps, column_steps, samples, *pixels]


def fill_holes(g: Nodes, geometry: Geometry, inputs: Inputs, probes: list[str]) -> tuple[str, str, str]:
    """Luminance at the colour sites of every block, (sites, blocks), its mean over the sites, and its contrast, (1, blocks).

    It is a weighted mean of the interpolations along rows and along columns. The weights are the inverse squared differences around
    the block, so that the direction with less change counts more. Contrast is the larger of these differences beyond the noise.
    """
    rows, columns, *steps = probes[:4]
    variance = inputs.variance(g, g("Slice", rows, [0], [1], [0]))  # at any site
    least = g("Add", inputs.still, g("Mul", variance, 2.0))  # what noise alone adds to a squared difference
    row_change, column_change = (
        g("Add", g.mean(g("Mul", each, each), count, axis=0), least) for each, count in zip(steps, geometry.kinds[2:4], strict=True)
    )
    along_rows = g("Div", column_change, g("Add", row_change, column_change))
    filled = g("Add", columns, g("Mul", g("Sub", rows, columns), along_rows))
    contrast = g("Relu", g("Sub", g("Max", row_change, column_change), least)) if geometry.scale == 1 else ""
    return filled, g.mean(filled, len(geometry.readings), axis=0), contrast


def estimate_chromaticities(g: Nodes, geometry: Geometry, inputs: Inputs, probes: list[str], filled: str, luminance: str) -> str:
    """Chromaticity c_j of every block, (C, blocks): the exact minimiser of Eqs. 8-9 under sum_i gamma_i c_i = 1."""
    channels = [sites[0][2] for sites in geometry.readings]
    counts = [channels.count(channel) for channel in range(inputs.channels)]

    def of_channels(products: str) -> str:
        if set(counts) == {1}:
            return products
        parts = g.split(products, counts, axis=0)
        return g("Concat", *(g.total(part, count, axis=0) for part, count in zip(parts, counts, strict=True)), axis=0)

    variance = g("Max", inputs.variance(g, luminance), _LEAST_VARIANCE)
    full_scale = g.total(inputs.gamma, inputs.channels, axis=0)
    a = g("Add", of_channels(g("Mul", filled, filled)), variance)
    free = g("Div", g("Add", of_channels(g("Mul", filled, probes[4])), g("Div", variance, full_scale)), a)
    pull = g("Div", inputs.gamma, a)
    missing = g("Sub", 1.0, g.total(g("Mul", free, inputs.gamma), inputs.channels, axis=0))
    return g("Add", free, g("Mul", pull, g("Div", missing, g.total(g("Mul", pull, inputs.gamma), inputs.channels, axis=0))))


def pool(g: Nodes, inputs: Inputs, chromaticity: str, luminance: str) -> tuple[str, str]:
    """Chromaticities of the inner blocks, (C, inner blocks), and what weighs a block in `propagate`, (2, inner blocks).

    That is 1 / luminance, and the squared relative difference at which the weight is halved.

    The lower the signal-to-noise ratio of a block, the more its chromaticity becomes the mean of the 3 x 3 blocks around it,
    weighted by squared luminance, which is their precision.
    """
    variance = inputs.variance(g, luminance)
    light = g("Max", luminance, inputs.floor)
    power = g("Mul", light, light)
    sums = g("Concat", g("Mul", chromaticity, power), power, axis=0)
    around = sums
    for axis in (1, 2):
        around = g.sum([g("Slice", around, [first], [last], [axis]) for first, last in ((0, -2), (1, -1), (2, END))])
    light, power, variance, own = (g("Slice", each, [1, 1], [-1, -1], [1, 2]) for each in (light, power, variance, sums))
    share = g("Div", variance, g("Add", variance, g("Mul", power, _POOLING)))
    pooled, weight = g.split(g("Add", own, g("Mul", g("Sub", around, own), share)), (inputs.channels, 1), axis=0)
    least = g("Add", g("Mul", g("Div", variance, power), _NOISE_WEIGHT), _CONTRAST)
    return g("Div", pooled, weight), g("Concat", g("Div", 1.0, light), least, axis=0)


def in_picture_units(g: Nodes, inputs: Inputs, chromaticity: str, white: str) -> str:
    """Chromaticities that, multiplied by luminance in codes, give scene units, or fractions of display white."""
    return g("Mul", chromaticity, g("Unsqueeze", g("Div", inputs.unit, white), [1, 2]) if white else inputs.unit)


def settle(g: Nodes, geometry: Geometry, inputs: Inputs, probes: list[str], filled: str, chromaticity: str, contrast: str) -> str:
    """`filled` of the inner blocks, corrected by what the samples say, (sites, inner blocks).

    What chromaticity times luminance misses at the sites of a block is mapped to errors of luminance there (`shared.site_errors`),
    as far as it is more than noise, and as there is contrast: next to flat luminance it is an error of colour.
    """
    samples, filled, contrast = (g("Slice", each, [1, 1], [-1, -1], [1, 2]) for each in (probes[4], filled, contrast))
    channels, count = [channel for _, _, channel in geometry.sites], len(geometry.sites)
    gamma = g("Gather", inputs.gamma, channels)
    missed = g("Mul", g("Sub", samples, g("Mul", g("Gather", chromaticity, channels), filled)), gamma)
    power = g("Mul", g.total(g("Mul", missed, missed), count, axis=0), 1 / count)
    weight = g("Mul", g.total(g("Mul", gamma, gamma), count, axis=0), _MISSED_NOISE / count)
    noise = g("Mul", inputs.variance(g, g("Mul", g.total(samples, count, axis=0), 1 / count)), weight)
    contrast = g("Mul", contrast, _DOUBT)
    share = g(
        "Div", g("Mul", g("Relu", g("Sub", power, noise)), contrast), g("Add", g("Mul", power, g("Add", contrast, power)), 1e-12)
    )
    if geometry.pattern.is_scattered:  # of many sites: two nodes each, not one per pair
        parts = zip(g.split(missed, [1] * count, axis=0), geometry.settling.T, strict=True)
        errors = g.sum([g("Mul", part, column[:, None, None]) for part, column in parts])
    else:
        errors = g("Concat", *(g.total(g("Mul", missed, row[:, None, None]), count, axis=0) for row in geometry.settling), axis=0)
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
            values = [
                g(
                    "Slice",
                    filled,
                    [site, hole.down, hole.right],
                    [site + 1, *(END if far else -1 for far in (hole.down, hole.right))],
                    [0, 1, 2],
                )
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
    if measured:
        # Around the blocks at the corners of the patches there is one more on each side, see `Geometry.halo`.
        places = [(pixel, *geometry.corner(pixel)) for pixel in range(len(geometry.pixels))]
        parts = [g("Slice", measured, [n, 1 + i, 1 + j], [n + 1, i - 2, j - 2], [0, 1, 2]) for n, i, j in places]
        sums = g("Concat", *parts, axis=0)
    else:
        above, below, left, right = geometry.halo
        codes = g("Slice", contract.MOSAIC, [above, left], [-below, -right], [0, 1])
        image = g("Unsqueeze", g("Cast", codes, to=FLOAT), [0, 1])
        sums = g("Squeeze", g("Conv", image, geometry.pixels[:, None], strides=[geometry.pattern.period] * 2), [0])
    light = g("Sub", g("Div", sums, geometry.pixels.sum(axis=(1, 2))[:, None, None]), inputs.black)
    count, cells = geometry.within**2, geometry.across**2
    mean = light if count == 1 else g("Mul", g.sum(g.split(light, [cells] * count, axis=0)), 1 / count)
    return [g.reshape(light, [count, 1, cells, *inputs.patches])], mean


def propagate(g: Nodes, geometry: Geometry, blocks: str, cells: str) -> str:
    """Colour (see `pool`) of every cell, (C, cells, patches): a convex combination of the four blocks at the corners of its patch.

    The weight of a block falls with its distance, and with the squared difference between its luminance and that of the cell.
    """
    place = (np.arange(geometry.across) + 0.5) / geometry.across
    weights, mixed = [], []
    for down in (0, 1):
        for right in (0, 1):
            near = np.outer(place if down else 1 - place, place if right else 1 - place) ** _SPREAD
            ends = [END if down else -1, END if right else -1]
            inverse, least, colour = (
                g("Slice", blocks, [first, down, right], [last, *ends], [0, 1, 2]) for first, last in ((0, 1), (1, 2), (2, END))
            )
            apart = g("Sub", g("Mul", cells, inverse), 1.0)
            weights.append(g("Div", near.reshape(-1, 1, 1), g("Add", g("Mul", apart, apart), least)))
            mixed.append(g("Mul", weights[-1], g("Unsqueeze", colour, [1])))
    return g("Div", g.sum(mixed), g.sum(weights))


def burnt_out(g: Nodes, inputs: Inputs, light: str) -> str:
    """Luminance of pixels that are shown: so high where samples are saturated that every channel is white.

    There the measured luminance is too low, and chromaticity wrong (see `shared.display`).
    """
    first, last = SATURATED
    slope = (_BURNT * last - first) / (last - first)
    full_scale = g("Div", g.total(inputs.gamma, inputs.channels, axis=0), inputs.unit)
    return g("Max", light, g("Sub", g("Mul", light, slope), g("Mul", full_scale, first * (slope - 1))))


def display(g: Nodes, camera: str) -> str:
    """Convert camera RGB relative to display white, (m, C, ...), to sRGB codes, uint8 (m, 3, n), as `ColourTransform` does."""
    flat = g("Reshape", g("Clip", camera, -1.0, 1.0), [0, 0, -1])
    # A sum of C products, which the kernels of all processors add in order; the only place where a multiply-add may be fused.
    linear = g("Conv", flat, g("Unsqueeze", contract.MATRIX, [2]), np.full(3, _SHIFT))
    root = g("Sqrt", g("Clip", linear, _SHIFT, 2.0))
    curve = g("Sub", root, g("Div", _BEND, g("Add", root, _KNEE)))
    return g("QuantizeLinear", curve, 1 / _GAIN, np.array(_OFFSET, np.uint8))


def interleave(g: Nodes, geometry: Geometry, inputs: Inputs, planes: list[str], *, linear: bool) -> str:
    """Assemble the picture (rows, columns, channels) from its planes, (pixels, channels, cells, patches) in one tensor or more."""
    within, across, channels = geometry.within, geometry.across, inputs.channels if linear else 3
    values = planes[0] if len(planes) == 1 else g("Concat", *(g("Reshape", each, [1, channels, -1]) for each in planes), axis=0)
    values = g.reshape(values, [within, within, channels, across, across, *inputs.patches])
    # Depth to space in two steps: move whole rows of patches into place, then interleave the columns.
    values = g("Transpose", values, perm=[5, 3, 0, 4, 1, 2, 6])
    values = g.reshape(values, [-1, within * across * channels, inputs.patches[1]])
    return g("Reshape", g("Transpose", values, perm=[0, 2, 1]), [0, -1, channels])


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
