"""Measurements of the whole frame before colour is spread: the input of the stages in rows."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..shared.arrays import BoolArray, ByteArray, FloatArray
from ..shared.block_grid import BlockGrid
from ..shared.calibration import NoiseModel, SensorCalibration
from ..shared.errors import InputError
from ..shared.pattern import CfaPattern
from .bands import Band
from .frame import Sites

EVEN = 0.01 / 3
"""Distance of colours from their line, a share of the luminance, that even surfaces have: less of
it is not taken off.

Chosen: half or twice changes 0.1 dB.
"""


@dataclass(frozen=True, eq=False)
class ColourLines:
    """Colour as a linear function of luminance, around each whole block (see
    `stages.colour_lines`).

    Attributes
    ----------
    offset, slope : FloatArray
        Of gamma_i times channel i, in units of luminance, float32 (C, rows, columns); they sum to 0
        and to 1.
    share : FloatArray
        How far each line is believed, 0 to 1, float32 (rows, columns).
    span : FloatArray
        Lowest and highest luminance at the sites of the blocks around, float32 (2, rows, columns):
        what is darker or brighter has the colour of that end.
    """

    offset: FloatArray
    slope: FloatArray
    share: FloatArray
    span: FloatArray

    def at(self, luminance: FloatArray) -> FloatArray:
        """The channels at a `luminance`, (rows, columns), or (C, rows, columns) of places
        of each channel.
        """
        return self.offset + self.slope * luminance


@dataclass(frozen=True, eq=False)
class BlockSamples:
    """Samples of the B = (rows, columns) whole blocks of a frame at their S sites, and the
    confidence in them.

    Attributes
    ----------
    sites : Sites
        Where they are.
    samples : FloatArray
        float32 (*B, S), scene units, defects mended and highlights restored.
    noise : NoiseModel | None
        Of the samples; None = there is none, or it is unknown.
    unclipped : BoolArray
        bool B, blocks without a sample at the sensor's limit in them or next to them.
    fill_error : FloatArray
        Standard deviation of the error of filled luminance, float32 B, scene units.
    kept : FloatArray | None
        Share of the errors of colour that the correction at the sites takes up, float32 B, 0 to 1;
        None = all of them. A burst corrects the rest itself, with the samples of all frames;
        `fill_error` says the same of luminance.
    lines : ColourLines | None
        Colour as a function of luminance around the blocks; None = not asked for.
    """

    sites: Sites
    samples: FloatArray
    noise: NoiseModel | None
    unclipped: BoolArray
    fill_error: FloatArray
    kept: FloatArray | None = None
    lines: ColourLines | None = None

    def within(self, band: Band) -> slice:
        """The rows of blocks that lie wholly inside a band of the picture."""
        grid = self.sites.grid
        first = grid.whole_rows - band.first
        inside = np.flatnonzero((first >= 0) & (first + grid.block_shape[0] <= len(band.luminance)))
        return slice(int(inside[0]), int(inside[-1]) + 1) if inside.size else slice(0, 0)

    def inside(self, band: Band, rows: slice) -> list[tuple[slice, slice]]:
        """Coordinates of each site of these rows of blocks in a band of the picture: slices of its
        rows and columns.
        """
        return self.sites.at(rows, band.first)

    def residual(self, band: Band, rows: slice) -> FloatArray:
        """Residual of the band at the sites of these rows of blocks, (rows, columns, S)."""
        if band.residual is None:
            raise InputError(
                "no stage has measured the residual of the picture at the colour sites: the "
                "stage 'residual' has to come before, and "
                "stages of one's own keep Band.residual, as dataclasses.replace does"
            )
        return np.stack([band.residual[place] for place in self.inside(band, rows)], axis=2)

    def scaled_variance(self, gamma: FloatArray, rows: slice) -> FloatArray | None:
        """Variance of the noise in the residual, float32 (rows, columns, S); None = no noise."""
        if self.noise is None or not self.noise.of_colours:
            return None
        channels = self.sites.channels
        return self.noise.variance(self.samples[rows], channels) * gamma[channels] ** 2


@dataclass(frozen=True, eq=False)
class Measured:
    """Measurements of the whole frame before colour is spread.

    Attributes
    ----------
    pattern : CfaPattern
        Of the frame.
    calibration : SensorCalibration
        Of the samples. With shading, light still falls off as of the panchromatic plane, equally
        for all filters.
    luminance : FloatArray
        Of every pixel, float32 (H, W), scene units, as everything here.
    blocks : FloatArray
        Chromaticity of every block, float32 (block rows, block columns, C).
    samples : BlockSamples | None
        Of the whole blocks; None where the settings do nothing with them.
    lost : ByteArray | None
        Where a clipped shot does not tell how bright it was, uint8 (H, W), see `Cleaned`; None =
        nowhere.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import measure
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((30, 40), 0.75, np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> measure(grey).shape
    (30, 40)
    """

    pattern: CfaPattern
    calibration: SensorCalibration
    luminance: FloatArray
    blocks: FloatArray
    samples: BlockSamples | None = None
    lost: ByteArray | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""
        return self.luminance.shape[0], self.luminance.shape[1]

    @cached_property
    def grid(self) -> BlockGrid:
        """The blocks of the frame."""
        return self.pattern.grid(self.shape)

    @property
    def gamma(self) -> FloatArray:
        """The weights of Eq. 7, (C,)."""
        return np.array(self.calibration.gamma, np.float32)
