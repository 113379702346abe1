"""The colour filter pattern: a K x K tile of filter letters, repeated over the sensor (section 3, Fig. 1).

All but one small block of each tile is panchromatic. The letters of the block name channels; nothing here
knows that there are three.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .arrays import BoolArray, ByteArray, FloatArray, IndexArray
from .errors import InputError

PANCHROMATIC = "W"
PERIODS = range(3, 17)
BAYER_ORDERS = ("RGGB", "BGGR", "GRBG", "GBRG")


@dataclass(frozen=True)
class CfaPattern:
    """A K x K tile (K = 3..16) with one block of colour filters, laid over the sensor.

    tile: K strings of K letters; "W" is panchromatic, any other capital letter names a colour channel. The colour sites must hang
        together (8-neighbours, across the tile's edge too) and leave at least one panchromatic row and column between blocks.
    origin: sensor (row, column) at which a tile begins; only its remainder modulo K matters.
    channels: the order of the channels in every array; by default "RGB" for those three, otherwise the order of the tile's rows.
    Raises InputError for anything else.
    """

    tile: tuple[str, ...]
    origin: tuple[int, int] = (0, 0)
    channels: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "tile", tuple(self.tile))
        period = len(self.tile)
        if period not in PERIODS:
            raise InputError(f"pattern: the tile has {period} rows; the period must be {PERIODS[0]} to {PERIODS[-1]}")
        for row in self.tile:
            if len(row) != period:
                raise InputError(f"pattern: tile row {row!r} has {len(row)} letters, expected {period}: tiles are square")
            if not (row.isascii() and row.isalpha() and row.isupper()):
                raise InputError(f"pattern: tile row {row!r} must consist of the letters A to Z")
        letters = "".join(self.tile).replace(PANCHROMATIC, "")
        found = "".join(dict.fromkeys(letters))
        if len(found) < 2:
            raise InputError(f"pattern: the tile has {len(found)} colour channels; at least two are needed")
        if not self.channels:
            object.__setattr__(self, "channels", "RGB" if set(found) == set("RGB") else found)
        if sorted(self.channels) != sorted(found):
            raise InputError(f"pattern: channels {self.channels!r} do not name the tile's letters {found!r}, each once")
        row_origin, column_origin = (int(value) % period for value in self.origin)
        object.__setattr__(self, "origin", (row_origin, column_origin))
        self._check_block()

    @classmethod
    def bayer(cls, period: int = 6, order: str = "RGGB", origin: tuple[int, int] = (0, 0)) -> "CfaPattern":
        """The paper's pattern: one 2x2 Bayer block in the first corner of each K x K tile."""
        if order not in BAYER_ORDERS:
            raise InputError(f"pattern: unknown Bayer order {order!r}; one of {', '.join(BAYER_ORDERS)}")
        return cls.with_block((order[:2], order[2:]), period, origin)

    @classmethod
    def with_block(cls, block: tuple[str, ...], period: int, origin: tuple[int, int] = (0, 0), channels: str = "") -> "CfaPattern":
        """A tile with `block` (rows of letters) in its first corner, panchromatic elsewhere."""
        if period not in PERIODS:
            raise InputError(f"pattern: the period is {period}, expected {PERIODS[0]} to {PERIODS[-1]}")
        rows = [row + PANCHROMATIC * (period - len(row)) for row in block]
        return cls((*rows, *[PANCHROMATIC * period] * (period - len(block))), origin, channels)

    @property
    def period(self) -> int:
        """K, pixels from one block's origin to the next."""
        return len(self.tile)

    @property
    def planes(self) -> str:
        """The letters of all filter planes: the channels, then panchromatic."""
        return self.channels + PANCHROMATIC

    @cached_property
    def block_origin(self) -> tuple[int, int]:
        """Sensor (row, column) of the first corner of a block, each in 0..K-1."""
        row, column = (_span(self._occupied(axis))[0] for axis in (1, 0))
        return (row + self.origin[0]) % self.period, (column + self.origin[1]) % self.period

    @cached_property
    def block_shape(self) -> tuple[int, int]:
        """(rows, columns) of the rectangle around the colour sites of one block; (2, 2) for a Bayer block."""
        rows, columns = (_span(self._occupied(axis))[1] for axis in (1, 0))
        return rows, columns

    @cached_property
    def sites(self) -> tuple[tuple[int, int, int], ...]:
        """The colour sites of a block: (row, column) from the block's origin, and the channel index."""
        block = self.filter_map(self.block_shape, first=self.block_origin)
        return tuple((row, column, int(block[row, column])) for row, column in np.argwhere(block < len(self.channels)).tolist())

    @property
    def light_efficiency(self) -> float:
        """Light collected relative to a Bayer sensor, when a panchromatic pixel sees what three colour filters let through."""
        colour = len(self.sites)
        return (3 * (self.period**2 - colour) + colour) / self.period**2

    def filter_map(self, shape: tuple[int, int], first: tuple[int, int] = (0, 0)) -> ByteArray:
        """Plane index of every pixel, uint8 `shape`: i for channel i, C for panchromatic; `first` is the sensor pixel at [0, 0]."""
        rows, columns = (
            (np.arange(size) + start - origin) % self.period for size, start, origin in zip(shape, first, self.origin, strict=True)
        )
        planes: ByteArray = self._tile_planes[np.ix_(rows, columns)]
        return planes

    @cached_property
    def lattices(self) -> tuple[tuple[int, slice, slice], ...]:
        """(channel, rows, columns) per colour site of a block: the slices of any frame that hold all of its repetitions."""
        period, (down, across) = self.period, self.block_origin
        return tuple(
            (channel, slice((down + row) % period, None, period), slice((across + column) % period, None, period))
            for row, column, channel in self.sites
        )

    def panchromatic_mask(self, shape: tuple[int, int], first: tuple[int, int] = (0, 0)) -> BoolArray:
        """Omega_L: where luminance is measured directly; bool `shape`; `first` as of `filter_map`."""
        mask: BoolArray = self.filter_map(shape, first) == len(self.channels)
        return mask

    def letters_from(self, first: tuple[int, int] = (0, 0)) -> tuple[str, ...]:
        """The K x K letters seen from sensor pixel `first` on: the tile with its origin applied."""
        square = self.filter_map((self.period, self.period), first)
        return tuple("".join(self.planes[plane] for plane in row) for row in square.tolist())

    def cropped(self, top: int, left: int) -> "CfaPattern":
        """The same pattern for a mosaic that begins at this one's pixel (top, left)."""
        return CfaPattern(self.tile, (self.origin[0] - top, self.origin[1] - left), self.channels)

    def grid(self, shape: tuple[int, int]) -> "BlockGrid":
        """The blocks and K x K patches over a frame of `shape`; raises InputError when no whole block lies inside."""
        return BlockGrid(self.period, self.block_origin, self.block_shape, shape)

    @cached_property
    def _tile_planes(self) -> ByteArray:
        return np.array([[self.planes.index(letter) for letter in row] for row in self.tile], np.uint8)

    @cached_property
    def _colour(self) -> BoolArray:
        colour: BoolArray = self._tile_planes != len(self.channels)
        return colour

    def _occupied(self, axis: int) -> BoolArray:
        """Which rows (axis 1) or columns (axis 0) of the tile hold a colour site."""
        return np.logical_or.reduce(self._colour, axis=axis)  # type: ignore[no-any-return]

    def _check_block(self) -> None:
        for axis, name in ((1, "row"), (0, "column")):
            if self._occupied(axis).all():
                raise InputError(f"pattern: no panchromatic {name} between the blocks: the colour sites must form one small block")
        reached = {tuple(np.argwhere(self._colour)[0].tolist())}
        front = list(reached)
        while front:
            row, column = front.pop()
            for neighbour in (
                ((row + down) % self.period, (column + right) % self.period) for down in (-1, 0, 1) for right in (-1, 0, 1)
            ):
                if self._colour[neighbour] and neighbour not in reached:
                    reached.add(neighbour)
                    front.append(neighbour)
        if len(reached) != int(self._colour.sum()):
            raise InputError("pattern: the tile has more than one block of colour sites; give the smallest tile that repeats")


@dataclass(frozen=True)
class BlockGrid:
    """Blocks on the coarse grid, and the K x K patches between them, over one frame.

    A patch begins in the middle of a block, so that its four corners lie in (2x2 blocks) or beside four blocks (Fig. 2). Patches
    cover the frame; the frame mirrored out to whole patches is the *domain*. Blocks are indexed from the first patch's first corner
    and may lie partly or wholly outside the frame: those measure nothing and stand for the nearest whole one.
    """

    period: int
    block_origin: tuple[int, int]
    block_shape: tuple[int, int]
    frame: tuple[int, int]

    def __post_init__(self) -> None:
        if not self.inside.any():
            raise InputError(
                f"a frame of {self.frame[1]} x {self.frame[0]} pixels holds no whole colour block of this pattern "
                f"(period {self.period}); {2 * self.period} x {2 * self.period} pixels always do"
            )

    @cached_property
    def padding(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Pixels ((above, below), (left, right)) of mirrored frame that make it whole patches."""
        above, left = (
            -(origin + size // 2) % self.period for origin, size in zip(self.block_origin, self.block_shape, strict=True)
        )
        return (above, -(above + self.frame[0]) % self.period), (left, -(left + self.frame[1]) % self.period)

    @cached_property
    def patches(self) -> tuple[int, int]:
        """Number of patches (down, across); the domain has K times as many rows and columns."""
        rows, columns = ((size + sum(pad)) // self.period for size, pad in zip(self.frame, self.padding, strict=True))
        return rows, columns

    @property
    def shape(self) -> tuple[int, int]:
        """Number of blocks (down, across): the corners of the patches."""
        return self.patches[0] + 1, self.patches[1] + 1

    @cached_property
    def rows(self) -> IndexArray:
        """Frame row of each block row's first pixel; may lie outside the frame."""
        return self._origins(0)

    @cached_property
    def columns(self) -> IndexArray:
        """Frame column of each block column's first pixel; may lie outside the frame."""
        return self._origins(1)

    @cached_property
    def inside(self) -> BoolArray:
        """Which blocks lie wholly inside the frame; bool `shape`."""
        down, across = (
            (origins >= 0) & (origins + block <= size)
            for origins, block, size in zip((self.rows, self.columns), self.block_shape, self.frame, strict=True)
        )
        return down[:, None] & across[None, :]

    @property
    def whole_rows(self) -> IndexArray:
        """The `rows` of whole blocks: frame row of the first pixel of each block row that lies inside the frame."""
        return self.rows[self.inside.any(axis=1)]

    @property
    def whole_columns(self) -> IndexArray:
        """The `columns` of whole blocks: frame column of the first pixel of each block column that lies inside the frame."""
        return self.columns[self.inside.any(axis=0)]

    def extend(self, measured: FloatArray) -> FloatArray:
        """Values of the whole blocks (rows inside, columns inside, ...) -> of all blocks: an outer one takes its nearest."""
        return np.pad(measured, (*self._outside, *[(0, 0)] * (measured.ndim - 2)), mode="edge")

    @cached_property
    def _outside(self) -> tuple[tuple[int, int], tuple[int, int]]:
        down, across = (np.flatnonzero(self.inside.any(axis=axis)) for axis in (1, 0))
        return (int(down[0]), self.shape[0] - 1 - int(down[-1])), (int(across[0]), self.shape[1] - 1 - int(across[-1]))

    def _origins(self, axis: int) -> IndexArray:
        first = -self.padding[axis][0] - self.block_shape[axis] // 2
        return first + self.period * np.arange(self.shape[axis])


def _span(occupied: BoolArray) -> tuple[int, int]:
    """Start and length of the shortest run, on a ring, that covers all True entries."""
    (places,) = np.nonzero(occupied)
    gaps = np.diff(places, append=places[0] + occupied.size)
    widest = int(np.argmax(gaps))
    return int(places[(widest + 1) % places.size]), occupied.size - int(gaps[widest]) + 1
