"""The preview as an ONNX graph: mosaic -> luminance -> chromaticity -> propagation -> picture.

Until the last stage, light is measured in codes of a panchromatic sample above black. Tensors end
with the axes (block rows, block columns) or (patch rows, patch columns): the pixels at one place of
all K x K patches form one plane (space to depth). Thus each colour site is a plane, and no stage
needs to find out the filter of a pixel.

Every operation rounds once, as IEEE 754 prescribes, and the order of every sum is either irrelevant
or fixed in the graph, so that all processors with fused multiply-add give the same bytes. This
rules out the operators for reciprocals, powers, exponentials and reductions, and allows
convolutions only for exact sums (in `luminance`) and for the colour matrix (in `picture`), the one
place where processors without that instruction round otherwise.
"""

from ...shared.pattern import CfaPattern
from . import contract
from .chromaticity import estimate_ratios, pool, propagate
from .luminance import bin_pixels, correct_luminance, fill_holes, fill_pixels, measure_blocks
from .nodes import FLOAT, UINT8, UINT16, Shape, Variable
from .pattern_graph import PatternGraph
from .picture import burnt_out, display, in_picture_units, interleave

BUILDER = "15"
"""Version of the builder, stored in the graph; increase it whenever the bytes of a graph change, or
pictures of `Preview`.
"""


def build_preview(pattern: CfaPattern, scale: int = 1, *, linear: bool = False) -> bytes:
    """Build the graph for all mosaics of a pattern, an ONNX file; `contract` describes its inputs
    and outputs.

    The bytes are always the same.

    Parameters
    ----------
    pattern : CfaPattern
        The filter pattern; its origin does not matter.
    scale : int, optional
        Sensor pixels per picture pixel, each way; one of `Geometry.scales(pattern)`.
    linear : bool, optional
        Camera RGB in scene units instead of a picture for a screen.

    Raises
    ------
    InputError
        For any other scale.
    """
    g = PatternGraph(pattern, scale, linear=linear)
    blocks = fill_holes(g, measure_blocks(g))
    ratios, luminance, limit = pool(g, estimate_ratios(g, blocks), blocks)  # Eqs. 8-9
    colour = in_picture_units(g, ratios)
    if scale == 1:
        pixels, coarse = fill_pixels(g, correct_luminance(g, blocks, ratios))
    else:
        pixels, coarse = bin_pixels(g)
    white = "" if linear else burnt_out(g, coarse)
    spread = propagate(g, colour, luminance, limit, coarse, white)  # Eq. 10
    camera = [g("Mul", pixel, spread) for pixel in pixels]  # Eq. 17
    return _finished(g, interleave(g, camera if linear else [display(g, each) for each in camera]))


def _finished(g: PatternGraph, picture: str) -> bytes:
    """The graph as a file that says what its inputs are and which pattern it is for."""
    channels, planes = g.channels, [g.channels + 1]
    sizes: dict[str, Shape] = {contract.BLACK: planes, contract.SCALE: planes}
    sizes |= {contract.GAMMA: [channels], contract.NOISE: [2]}
    sizes[contract.GAIN] = ["gain_rows", "gain_columns"]
    if not g.linear:
        sizes |= {contract.WHITE: [channels], contract.MATRIX: [3, channels]}
    mosaic = contract.MOSAIC, UINT16 if g.geometry.scale == 1 else FLOAT, ["rows", "columns"]
    inputs = [mosaic, *((name, FLOAT, size) for name, size in sizes.items())]
    output: Variable = contract.PICTURE, FLOAT if g.linear else UINT8, ["height", "width", g.shown]
    facts = {
        "contract": contract.VERSION,
        "builder": BUILDER,
        "tile": contract.tile_name(g.geometry.pattern),
        "channels": g.geometry.pattern.channels,
        "scale": str(g.geometry.scale),
        "output": "linear" if g.linear else "display",
        "halo": " ".join(map(str, g.geometry.halo)),
    }
    return g.to_bytes(picture, inputs, output, facts)
