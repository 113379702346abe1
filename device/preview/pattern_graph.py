"""A preview graph under construction: the geometry of its pattern, and its inputs in the units of
the graph.
"""

from ...shared.pattern import CfaPattern
from . import contract
from .geometry import REACH, Geometry
from .nodes import Nodes

_LEAST_SIGNAL = 1e-3
"""Least luminance of a block, scene units; keeps ratios to it finite."""
_STILL = 1e-4
"""Mean squared difference, (scene units)^2, below which rows and columns have equal weight."""


class PatternGraph(Nodes):
    """The graph of one pattern and scale. Every method appends nodes and returns the name of the
    result.

    The attributes are the geometry, the number of `channels` of the sensor, that of those `shown`
    in the picture, and names of results: the size of the frame in `patches` (rows, columns), and
    the inputs; `unit` is the scene units per panchromatic code, `full_scale` that of each block in
    codes, (1, blocks).

    Parameters
    ----------
    pattern : CfaPattern
        The filter pattern; its origin does not matter.
    scale : int
        Sensor pixels per picture pixel, each way; one of `Geometry.scales(pattern)`.
    linear : bool
        Camera RGB in scene units instead of a picture for a screen.

    Raises
    ------
    InputError
        For any other scale.
    """

    def __init__(self, pattern: CfaPattern, scale: int, *, linear: bool) -> None:
        super().__init__()
        self.geometry, self.linear = Geometry(pattern, scale), linear
        self.channels = channels = len(pattern.channels)
        self.shown = channels if linear else 3
        above, below, left, right = self.geometry.halo
        self.patches = []
        for axis, halo in enumerate((above + below, left + right)):
            size = self("Shape", contract.MOSAIC, start=axis, end=axis + 1)
            self.patches.append(self("Div", self("Sub", size, [halo]), [pattern.period]))
        self.gamma = self("Unsqueeze", contract.GAMMA, [1, 2])
        self.black = self("Slice", contract.BLACK, [channels], [channels + 1])
        self.unit = self("Slice", contract.SCALE, [channels], [channels + 1])
        square = self("Mul", self.unit, self.unit)
        reaches = zip(self.patches, REACH, strict=True)
        blocks = [self("Add", count, [1 + 2 * reach]) for count, reach in reaches]
        gain = self("Expand", contract.GAIN, self("Concat", [1], *blocks, axis=0))
        full_scale = self("Div", self.total(self.gamma, channels, axis=0), self.unit)
        self.full_scale = self("Mul", full_scale, gain)
        self.floor, self.still = self("Div", _LEAST_SIGNAL, self.unit), self("Div", _STILL, square)
        shot, read_variance = self.split(contract.NOISE, (1, 1), axis=0)
        # of samples that were multiplied by the gain
        self._shot = self("Mul", self("Div", shot, self.unit), gain)
        read_variance = self("Div", read_variance, square)
        self._read_variance = self("Mul", read_variance, self("Mul", gain, gain))

    def variance(self, luminance: str) -> str:
        """Noise variance sigma_z^2 of a panchromatic sample, codes^2, by the luminance of each
        block, (1, blocks).
        """
        return self("Add", self("Mul", self("Relu", luminance), self._shot), self._read_variance)

    def inner(self, values: str) -> str:
        """Values of the inner blocks, those at the corners of the patches, out of values of all
        blocks that are read.
        """
        return self("Slice", values, list(REACH), [-blocks for blocks in REACH], [1, 2])
