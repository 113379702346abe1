"""A frame whose samples all measure light: the start of every render, of single frames and of bursts.

Cleaning goes in two steps, because a burst compares its frames between them: first defects are mended, then highlights restored.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from shared.arrays import BoolArray, ByteArray, DoubleArray, FloatArray
from shared.calibration import NoiseModel
from shared.mosaic import Mosaic

from .blocks import Sites, Surroundings
from .numerics.pieces import BLOCK_ROWS, in_strips

_TINY = 1e-6  # scene units: the level of a black frame, which keeps shares of it above 0


@dataclass(frozen=True, eq=False)
class Cleaned:
    """The samples of a frame, and what is known of them.

    mosaic: float32 samples in scene units; its calibration has no shading, and the noise model if one is known or estimated.
    clipping: scene units from which on a sample was saturated.
    trust: how far the samples of each whole block add up to the luminance around it, 0 to 1, float64 (rows, columns); None = nobody
        asks.
    unclipped: bool (rows, columns), whole blocks without a saturated sample in them or next to them; None = not measured
        yet, see `unclipped_blocks`.
    lost: where a clipped shot does not tell how bright it was, nor of which colour: a picture to look at is white there. uint8
        (H, W), 255 = nothing is known; None = all is known.
    estimated: whether the noise model is an estimate from the samples.
    """

    mosaic: Mosaic
    clipping: float
    trust: DoubleArray | None = None
    unclipped: BoolArray | None = None
    lost: ByteArray | None = None
    estimated: bool = False

    @cached_property
    def sites(self) -> Sites:
        """The colour sites of the whole blocks."""
        return Sites.in_frame(self.mosaic)

    @cached_property
    def samples(self) -> DoubleArray:
        """The samples at these sites, float64 (rows, columns, S)."""
        return self.sites.of(self.signal, np.float64)

    @cached_property
    def around(self) -> Surroundings:
        """The panchromatic samples around these blocks."""
        return self.sites.surroundings(self.signal)

    @property
    def signal(self) -> FloatArray:
        """The samples, (H, W)."""
        return self.mosaic.signal

    @cached_property
    def level(self) -> float:
        """Mean of the panchromatic ones, more than 0: thresholds that are a share of it do not depend on the exposure."""
        coloured = [self.signal[rows, columns] for _, rows, columns in self.mosaic.pattern.lattices]
        total = self.signal.sum(dtype=np.float64) - sum(each.sum(dtype=np.float64) for each in coloured)
        return max(float(total) / (self.signal.size - sum(each.size for each in coloured)), _TINY)

    @property
    def noise(self) -> NoiseModel | None:
        """Their noise; None = unknown, treated as none."""
        return self.mosaic.calibration.noise

    @property
    def gamma(self) -> DoubleArray:
        """The weights of Eq. 7, (C,)."""
        return np.array(self.mosaic.calibration.gamma)

    def with_samples(self, signal: FloatArray) -> "Cleaned":
        """The frame with other samples, which become read-only."""
        signal.flags.writeable = False
        return replace(self, mosaic=replace(self.mosaic, samples=signal))


def unclipped_blocks(frame: Cleaned) -> BoolArray:
    """The whole blocks that have no sample of `frame.clipping` or more in or next to them, bool (rows, columns)."""
    if frame.unclipped is not None:
        return frame.unclipped
    unclipped = np.ones(frame.sites.shape, np.bool_)
    if frame.signal.max() >= frame.clipping:
        height, width = frame.sites.grid.block_shape
        steps = [(down - 1, across - 1) for down, across in np.ndindex(height + 2, width + 2)]

        def work(rows: slice) -> None:
            for values in frame.sites.beside(frame.signal, rows, steps):
                unclipped[rows] &= ~(values >= frame.clipping)

        in_strips(work, len(unclipped), BLOCK_ROWS)
    return unclipped
