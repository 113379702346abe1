"""A frame: its samples, noise and clipping, its blocks with their sites, sums and surroundings, and
what stages learn of it.

Cleaning goes in two steps, because a burst compares its frames between them: first defects are
mended, then highlights restored. Then luminance and the colour of blocks are estimated, from which
the stages in rows make the picture.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..shared import BlockGrid, CfaPattern, InputError, Mosaic, NoiseModel, Shading
from ..shared.arrays import BoolArray, ByteArray, DoubleArray, FloatArray, IndexArray, mirrored
from .bands import DARK, Band
from .numerics.chunks import BLOCK_ROWS, in_strips

# pixels: the best on photographs among 1, 2 and 4, though sites have panchromatic neighbours
_WIDEST = 4


@dataclass(frozen=True)
class Sites:
    """The colour sites of the B = (rows, columns) blocks of a frame that lie wholly inside it, S
    sites in each.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline.frame import Sites
    >>> from panchroma.shared import CfaPattern
    >>> pattern = CfaPattern.bayer(6)
    >>> sites = Sites(pattern, pattern.grid((13, 20)))
    >>> sites.shape, sites.of(np.zeros((13, 20))).shape
    ((2, 4), (2, 4, 4))
    """

    pattern: CfaPattern
    grid: BlockGrid

    @classmethod
    def in_frame(cls, mosaic: Mosaic) -> "Sites":
        """The sites of a mosaic."""
        return cls(mosaic.pattern, mosaic.pattern.grid(mosaic.shape))

    @property
    def shape(self) -> tuple[int, int]:
        """B, the number of whole blocks (down, across)."""
        return len(self.grid.whole_rows), len(self.grid.whole_columns)

    @cached_property
    def channels(self) -> IndexArray:
        """The channel of each site, (S,)."""
        return np.array([channel for *_, channel in self.pattern.sites], np.intp)

    @property
    def places(self) -> list[tuple[slice, slice]]:
        """For each site the slices of the frame's rows and columns that hold it in all whole
        blocks.
        """
        return self.at(slice(0, self.shape[0]))

    def at(self, rows: slice, first: int = 0) -> list[tuple[slice, slice]]:
        """Places of these rows of blocks, 1 or more, in a plane whose first row is the frame's row
        `first`.
        """
        top, left = int(self.grid.whole_rows[rows.start]) - first, int(self.grid.whole_columns[0])
        (down, across), period = self._extent(rows), self.grid.period
        corners = ((top + row, left + column) for row, column, _ in self.pattern.sites)
        return [np.s_[y : y + down : period, x : x + across : period] for y, x in corners]

    def _extent(self, rows: slice) -> tuple[int, int]:
        """Rows and columns of the frame from one site of these rows of blocks to its last image."""
        period = self.grid.period
        return (rows.stop - rows.start - 1) * period + 1, (self.shape[1] - 1) * period + 1

    @property
    def pixels(self) -> tuple[IndexArray, IndexArray]:
        """Row and column of every site in the frame, (*B, S) each."""
        sites = np.array(self.pattern.sites)
        down = self.grid.whole_rows[:, None, None] + sites[:, 0]
        across = self.grid.whole_columns[None, :, None] + sites[:, 1]
        rows, columns = np.broadcast_arrays(down, across)
        return rows, columns

    @property
    def middle(self) -> tuple[float, float]:
        """Row and column of the middle of the first whole block."""
        (down, across), grid = self.pattern.block_shape, self.grid
        row, column = float(grid.whole_rows[0]), float(grid.whole_columns[0])
        return row + (down - 1) / 2, column + (across - 1) / 2

    @cached_property
    def ring(self) -> IndexArray:
        """Panchromatic pixels in and next to a block: row and column from the block's first pixel,
        (R, 2).
        """
        (top, left), (down, across) = self.pattern.block_origin, self.pattern.block_shape
        clear = self.pattern.panchromatic_mask((down + 2, across + 2), (top - 1, left - 1))
        return np.argwhere(clear) - 1

    def of(self, plane: NDArray[Any]) -> NDArray[Any]:
        """The values of a plane, (H, W), at all sites, (*B, S)."""
        return self.in_rows(plane, slice(0, self.shape[0]))

    def in_rows(self, plane: NDArray[Any], rows: slice, first: int = 0) -> NDArray[Any]:
        """The values of a plane, whose first row is the frame's row `first`, at the sites of these
        rows of blocks, (rows, columns, S).
        """
        return np.stack([plane[place] for place in self.at(rows, first)], axis=2)

    def within(self, band: Band) -> slice:
        """The rows of blocks that lie wholly inside a band of the picture."""
        first = self.grid.whole_rows - band.first
        ends = first + self.grid.block_shape[0]
        inside = np.flatnonzero((first >= 0) & (ends <= len(band.luminance)))
        return slice(int(inside[0]), int(inside[-1]) + 1) if inside.size else slice(0, 0)

    def residual(self, band: Band, rows: slice) -> FloatArray:
        """Residual of a band at the sites of these rows of blocks, (rows, columns, S)."""
        if band.residual is None:
            lacks = "no stage has measured the residual of the picture at the colour sites"
            raise InputError(f"{lacks}; the stage 'residual' does, and others keep Band.residual")
        return self.in_rows(band.residual, rows, band.first)

    def means(self, values: NDArray[Any]) -> NDArray[Any]:
        """The means of values, (*B, S), over the sites of each channel, (*B, C); a channel without
        sites reads the mean of the others, as in grey.
        """
        read = np.flatnonzero(self.pattern.site_counts)
        means = [values[..., self.channels == channel].mean(axis=2) for channel in read]
        if (derived := self.pattern.derived) is not None:
            means.insert(derived, np.mean(means, axis=0, dtype=values.dtype))
        return np.stack(means, axis=2)

    def surroundings(self, signal: FloatArray, rows: slice | None = None) -> "Surroundings":
        """Interpolate luminance at the sites from the panchromatic samples of a plane, (H, W), in
        and next to each block.

        At a site it is the mean of these samples, weighted by 1 / distance^2; 0 without samples.

        Parameters
        ----------
        rows : slice | None, optional
            Of blocks; None = all.
        """
        first, end = (0, self.shape[0]) if rows is None else (rows.start, rows.stop)
        # (S, R)
        near = 1 / np.square(self.ring - np.array(self.pattern.sites)[:, None, :2]).sum(axis=2)
        filled = np.empty((end - first, self.shape[1], len(near)))
        lowest, highest = np.empty((2, end - first, self.shape[1]))

        def work(rows: slice) -> None:
            values = self._in_ring(signal, slice(first + rows.start, first + rows.stop))
            inside = ~np.isnan(values)
            lowest[rows], highest[rows] = np.fmin.reduce(values), np.fmax.reduce(values)
            weight = np.einsum("sr,rij->ijs", near, inside)
            total = np.einsum("sr,rij->ijs", near, np.where(inside, values, 0))
            filled[rows] = total / np.where(weight > 0, weight, 1)

        in_strips(work, end - first, BLOCK_ROWS)
        return Surroundings(filled, lowest, highest)

    def _in_ring(self, plane: FloatArray, rows: slice) -> FloatArray:
        """The values of a plane, (H, W), in the rings of these rows of blocks, (R, rows, columns);
        NaN outside the frame.
        """
        top, left = int(self.grid.whole_rows[rows][0]), int(self.grid.whole_columns[0])
        (down, across), period = self._extent(rows), self.grid.period
        first = max(top - 1, 0)
        cut, sides = plane[first : top + down + period], ((top == 0, period), (left == 0, period))
        near = np.pad(cut, sides, constant_values=np.nan)
        corner = top - first + (top == 0), left + (left == 0)
        places = (self.ring + corner).tolist()
        return np.stack([near[y : y + down : period, x : x + across : period] for y, x in places])


def mean_of_sites(*factors: NDArray[Any]) -> NDArray[Any]:
    """The mean over the sites of each block, B, of a product of values, each (*B, S). Along an axis
    as short, NumPy's `mean` takes three times as long.
    """
    product = ",".join(["...s"] * len(factors)) + "->..."
    return np.einsum(product, *factors) / factors[0].dtype.type(factors[0].shape[-1])


class Surroundings(NamedTuple):
    """The panchromatic samples around blocks, float64, scene units.

    Attributes
    ----------
    filled : DoubleArray
        Luminance at the sites, interpolated from them, (*B, S).
    lowest, highest : DoubleArray
        Their range, B.
    """

    filled: DoubleArray
    lowest: DoubleArray
    highest: DoubleArray


@dataclass(frozen=True, eq=False)
class BlockSums:
    """The sums of Eqs. 8-9 of each whole block for each channel, (rows, columns, C); those of
    several frames add up.

    Attributes
    ----------
    weight : DoubleArray
        Sum l^2 over the sites of the channel.
    product : DoubleArray
        Sum l m.
    """

    weight: DoubleArray
    product: DoubleArray

    def __add__(self, other: "BlockSums") -> "BlockSums":
        return BlockSums(self.weight + other.weight, self.product + other.product)

    def solved(
        self, sigma: float, gamma: DoubleArray, expected: FloatArray | None = None
    ) -> DoubleArray:
        """Chromaticities, (rows, columns, C): the exact minimiser of Eqs. 8-9 under sum_i gamma_i
        c_i = 1, by a multiplier.

        Parameters
        ----------
        sigma : float
            sigma_z > 0, in the units of l.
        gamma : DoubleArray
            (C,), the weights of Eq. 7.
        expected : FloatArray | None, optional
            What they are pulled towards, as the result; None = grey, as in the paper.
        """
        chromaticities = np.empty(self.weight.shape)

        def work(rows: slice) -> None:
            a = self.weight[rows].astype(np.float64) + sigma**2
            towards = sigma**2 / gamma.sum() if expected is None else sigma**2 * expected[rows]
            free = (self.product[rows] + towards) / a  # Eqs. 8-9 without the constraint
            pull = gamma / a
            missing = 1 - free @ gamma
            chromaticities[rows] = free + pull * (missing / (pull @ gamma))[..., None]

        in_strips(work, len(chromaticities), BLOCK_ROWS)
        return chromaticities


def curvature(luminance: FloatArray, site: tuple[slice, slice], grid: BlockGrid) -> FloatArray:
    """Distance of luminance at a site from the mean of the pixels one block's size to either side;
    the larger of both axes.

    The error of filled luminance grows with it. A block that is a whole period counts as `_WIDEST`
    pixels wide at most.

    Parameters
    ----------
    site : tuple[slice, slice]
        Slices of the rows and columns of `luminance`.
    """
    is_whole = grid.block_shape == (grid.period, grid.period)
    block = (min(grid.period, _WIDEST),) * 2 if is_whole else grid.block_shape
    bends = []
    for axis, step in enumerate(block):
        sides = []
        for distance in (-step, step):
            places = [np.arange(along.start, along.stop, along.step) for along in site]
            places[axis] = mirrored(places[axis] + distance, luminance.shape[axis])
            sides.append(luminance[np.ix_(*places)])
        bends.append(np.abs(sum(sides) / 2 - luminance[site]))
    return np.maximum(*bends)


def unknown() -> FloatArray:
    """Make an empty plane, which stands for what has not been estimated."""
    return np.empty((0, 0), np.float32)


@dataclass(frozen=True, eq=False)
class Frame:
    """The samples of a frame, what is known of them, and what stages learn of it: in scene units.

    Attributes
    ----------
    mosaic : Mosaic
        float32 samples; its calibration has no shading, and the noise model if one is known or
        estimated. With `shading`, light still falls off as of the panchromatic plane, equally for
        all filters.
    clipping : float
        From which on a panchromatic sample was saturated; those of colours: `limits`.
    lost : ByteArray | None
        Where a clipped shot does not tell how bright it was, nor of which colour: a picture to look
        at is white there. uint8 (H, W), 255 = nothing is known; None = all is known.
    estimated : bool
        Whether the noise model is an estimate from the samples.
    shading : Shading | None
        By which the picture gets its shading, see `Mosaic.evenly_shaded`; None = there is none.
    luminance : FloatArray
        Of every pixel, float32 (H, W); empty until it is estimated.
    blocks : FloatArray
        Chromaticity of every block, float32 (block rows, block columns, C); empty until it is
        estimated.
    lines : FloatArray
        Of every block, how colour goes with luminance, a line: what a unit of luminance adds,
        chromaticity plus a slope, the slope times the luminance of the block, which is taken off,
        and the luminances at which it ends, float32 (block rows, block columns, 2 C + 2); empty
        where no network has found them.
    fill_error : FloatArray
        Standard deviation of the error of filled luminance in each of the B whole blocks, float32
        B; empty where the settings do nothing with the sites.
    others : BlockSums | None
        What the other frames of a burst add to the sums of Eqs. 8-9, while the colour of blocks is
        estimated; None = there are no others.
    kept : FloatArray | None
        Share of the errors of colour that the correction at the sites takes up, float32 B, 0 to 1;
        None = all of them. A burst corrects the rest itself, with the samples of all frames;
        `fill_error` says the same of luminance.
    site_noise : FloatArray | None
        Variance of the noise at the sites, relative to that of a sample, float32 B x S: those of a
        burst may be means of its frames; None = 1.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import measure
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> grey = Mosaic(np.full((30, 40), 0.75, np.float32), CfaPattern.bayer(6), SensorCalibration())
    >>> measure(grey).shape
    (30, 40)
    """

    mosaic: Mosaic
    clipping: float
    lost: ByteArray | None = None
    estimated: bool = False
    shading: Shading | None = None
    luminance: FloatArray = field(default_factory=unknown)
    blocks: FloatArray = field(default_factory=unknown)
    lines: FloatArray = field(default_factory=unknown)
    fill_error: FloatArray = field(default_factory=unknown)
    others: BlockSums | None = None
    kept: FloatArray | None = None
    site_noise: FloatArray | None = None

    @property
    def pattern(self) -> CfaPattern:
        """The filters."""
        return self.mosaic.pattern

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""
        return self.mosaic.shape

    @property
    def grid(self) -> BlockGrid:
        """The blocks."""
        return self.sites.grid

    @cached_property
    def sites(self) -> Sites:
        """The colour sites of the whole blocks."""
        return Sites.in_frame(self.mosaic)

    @cached_property
    def samples(self) -> DoubleArray:
        """The samples at these sites, float64 (rows, columns, S)."""
        return self.sites.of(self.signal).astype(np.float64)

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
        """Mean of the panchromatic ones, `DARK` or more: thresholds that are a share of it do not
        depend on the exposure.
        """
        coloured = [self.signal[rows, columns] for _, rows, columns in self.mosaic.pattern.lattices]
        sums = (samples.sum(dtype=np.float64) for samples in coloured)
        total = float(self.signal.sum(dtype=np.float64) - sum(sums))
        count = self.signal.size - sum(samples.size for samples in coloured)
        return max(total / count, DARK)

    @property
    def noise(self) -> NoiseModel | None:
        """Their noise; None = unknown, treated as none."""
        return self.mosaic.calibration.noise

    @property
    def gamma(self) -> DoubleArray:
        """The weights of Eq. 7, (C,)."""
        return np.array(self.mosaic.calibration.gamma)

    @property
    def gamma32(self) -> FloatArray:
        """The same in float32, for stages in rows."""
        return self.gamma.astype(np.float32)

    @cached_property
    def unclipped(self) -> BoolArray:
        """The whole blocks that have no saturated sample among their sites, and no panchromatic one
        in or next to them, bool (rows, columns); all of them where highlights are restored: they
        are samples like others then.
        """
        limits = self.limits(slice(0, self.sites.shape[0]))
        if self.lost is not None or self.signal.max() < min(self.clipping, limits.min()):
            return np.ones(self.sites.shape, np.bool_)
        colours = self.sites.of(self.signal) < limits
        beside = self.sites.surroundings(self.signal).highest < self.clipping
        return np.logical_and(colours.all(axis=2), beside)

    def variance(self, signal: FloatArray, rows: slice, channels: IndexArray) -> FloatArray:
        """Variance of the noise of samples of some channels in rows of whole blocks, float32 (rows,
        columns, channels); it was scaled with them when their shading was made even.
        """
        if self.noise is None:
            return np.zeros_like(signal)
        gains = self.colour_gains(rows, channels).astype(np.float32)
        return self.noise.variance(signal, channels, gains)

    def scaled_variance(self, rows: slice) -> FloatArray | None:
        """Variance of the noise at the sites of these rows of blocks, times gamma^2, float32 (rows,
        columns, S); None = no noise.
        """
        if self.noise is None or not self.noise.of_colours:
            return None
        channels, samples = self.sites.channels, self.sites.in_rows(self.signal, rows)
        variance = self.variance(samples, rows, channels) * self.gamma32[channels] ** 2
        return variance if self.site_noise is None else variance * self.site_noise[rows]

    def sum_noise(self, filled: DoubleArray) -> DoubleArray:
        """Standard deviation of the noise in what a block's channels add up to, less the luminance
        around it; float64 B.

        That is sum_i gamma_i (mean of the samples of channel i), less the mean of the panchromatic
        samples around the block (Eq. 7). Shot noise is that of a grey block. For a Bayer block with
        gamma = (1, 1, 1) it is 1.6 times the noise of one sample.

        Parameters
        ----------
        filled : DoubleArray
            Luminance at the sites, `(*B, S)`.
        """
        if self.noise is None:
            return np.zeros(self.sites.shape)
        channels, counts = self.sites.channels, self.pattern.site_counts
        shot, variance = np.array(self.noise.shot), np.array(self.noise.read) ** 2
        gains = self.colour_gains(slice(0, self.sites.shape[0]), channels)
        squares, around = (self.gamma / counts)[channels] ** 2, len(self.sites.ring)
        shot_noise = (gains * shot[channels]) @ squares / self.gamma.sum() + shot[-1] / around
        fixed = (gains**2 * variance[channels]) @ squares + variance[-1] / around
        return np.sqrt(shot_noise * np.maximum(mean_of_sites(filled), 0) + fixed)

    def colour_gains(self, rows: slice, channels: IndexArray) -> NDArray[Any]:
        """Gains by which samples of some channels in rows of whole blocks have the shading of
        panchromatic ones, float64 (rows, columns, channels); (1,) where there is no shading.
        """
        if self.shading is None:
            return np.ones(1)
        gain, shape, place = self.shading.of_plane, self.mosaic.shape, self.sites.at(rows)[0]
        *gains, panchromatic = (gain(shape, plane, *place) for plane in (*channels, -1))
        return np.stack(gains, axis=2, dtype=np.float64) / panchromatic[..., None]

    def limits(self, rows: slice) -> NDArray[Any]:
        """Levels from which on the samples at the sites of these rows of whole blocks were
        saturated, (rows, columns, S): `clipping`, scaled with them when their shading was made
        even; (S,) where there is no shading.
        """
        if self.shading is None:
            return np.full(len(self.sites.channels), self.clipping)
        gain, shape = self.shading.of_plane, self.mosaic.shape
        sites = zip(self.sites.channels, self.sites.at(rows), strict=True)
        ratios = [gain(shape, channel, *at) / gain(shape, -1, *at) for channel, at in sites]
        return self.clipping * np.stack(ratios, axis=2)

    def with_samples(self, signal: FloatArray) -> "Frame":
        """The frame with other samples, which become read-only."""
        signal.flags.writeable = False
        return replace(self, mosaic=replace(self.mosaic, samples=signal))
