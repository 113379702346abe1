"""The colour filter pattern: a K x K tile of filter letters, repeated over the sensor (section 3,
Fig. 1).

The paper's tile has one small block of colour filters, and all other pixels are panchromatic. Other
tiles scatter their colour sites among panchromatic ones (Kodak, Sony, Honda): there the whole tile
is the block. The letters name the channels, of which there may be any number.
"""

import re
from dataclasses import dataclass
from functools import cached_property
from math import lcm
from typing import Any

import numpy as np

from .arrays import BoolArray, ByteArray, IndexArray, Pair
from .block_grid import BlockGrid
from .colorimetry import COMPLEMENTS
from .errors import InputError, meant
from .figures import shown, whole
from .tiles import CLEAR, EXPECTED, TILES, letters_of, place_of

PANCHROMATIC = "W"
PERIODS = range(3, 17)
BAYER_ORDERS = ("RGGB", "BGGR", "GRBG", "GBRG")
MIRRORS = (1, 1), (1, -1), (-1, 1), (-1, -1)
"""Steps (down, across) through the four mirror images of a block, or of a tile."""
_FARTHEST = 2  # pixels, each way, from a colour site to the nearest panchromatic pixel at most


@dataclass(frozen=True)
class CfaPattern:
    """A K x K tile (K = 3..16) of colour filters and panchromatic pixels, laid over the sensor.

    Attributes
    ----------
    tile : tuple[str, ...]
        K strings of K letters; "W" is panchromatic, any other capital letter names a colour
        channel. If the colour sites do not form one small block, each needs a panchromatic pixel at
        most two rows and columns away.
    origin : tuple[int, int]
        Sensor (row, column) at which a tile begins; only its remainder modulo K matters.
    channels : str
        The order of the channels in every array; by default "RGB" for two or three of those,
        otherwise their order in the tile. One of them may have no filter in the tile: it is what
        panchromatic pixels see beyond the others, G = (W - gamma_R R - gamma_B B) / gamma_G
        (Eq. 7). A lone filter has such a companion in any case, red cyan, blue yellow.

    Raises
    ------
    InputError
        For any other tile, and for channels that are not the tile's letters.

    Examples
    --------
    >>> from panchroma.shared import CfaPattern
    >>> pattern = CfaPattern.bayer(period=4, order="RGGB")
    >>> pattern.tile
    ('RGWW', 'GBWW', 'WWWW', 'WWWW')
    >>> pattern.filter_map((2, 6)).tolist()  # 0, 1, 2: a channel; 3: panchromatic
    [[0, 1, 3, 3, 0, 1], [1, 2, 3, 3, 1, 2]]
    >>> CfaPattern.with_block(("CM", "YC"), period=6).channels
    'CMY'
    >>> CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW").is_scattered  # Kodak's (US patent 8330839)
    True
    >>> rccb = CfaPattern.of_letters("RW/WB")
    >>> rccb.channels, rccb.derived
    ('RGB', 1)
    """

    tile: tuple[str, ...]
    origin: Pair = (0, 0)
    channels: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "tile", tuple(self.tile))
        period = len(self.tile)
        if period not in PERIODS:
            expected = f"the period must be {PERIODS[0]} to {PERIODS[-1]}"
            raise InputError(f"pattern: the tile has {period} rows; {expected}")
        for row in self.tile:
            if len(row) != period or not re.fullmatch("[A-Z]+", row):
                expected = f"expected {period} of the letters A to Z: tiles are square"
                raise InputError(f"pattern: tile row {row!r} has {len(row)} letters, {expected}")
        present = "".join(dict.fromkeys("".join(self.tile).replace(PANCHROMATIC, "")))
        if PANCHROMATIC not in "".join(self.tile):
            reason = "the tile has no panchromatic pixel (W), which is where luminance is measured"
            raise InputError(f"pattern: {reason}")
        if not present:
            raise InputError("pattern: the tile has no colour filter; at least one is needed")
        if not self.channels:
            of_rgb = len(present) > 1 and set(present) <= set("RGB")
            companion = COMPLEMENTS.get(present, "")
            object.__setattr__(self, "channels", "RGB" if of_rgb else present + companion)
        named = self.channels
        if set(present) - set(named) or len(set(named)) < len(named) or PANCHROMATIC in named:
            reason = f"channels {named!r} do not name the tile's letters {present!r}, each once"
            raise InputError(f"pattern: {reason}")
        if len(set(named) - set(present)) > 1 or len(named) < 2:
            both = f"channels {named!r} of a tile with the letters {present!r}"
            seen = "it is what panchromatic pixels see beyond the others"
            expected = f"expected two or more, of which one at most has no filter: {seen}"
            raise InputError(f"pattern: {both}; {expected}")
        places = (whole("pattern: the origin", value) for value in self.origin)
        row_origin, column_origin = (place % period for place in places)
        object.__setattr__(self, "origin", (row_origin, column_origin))
        self._check_sites()

    @classmethod
    def bayer(cls, period: int = 6, order: str = "RGGB", origin: Pair = (0, 0)) -> "CfaPattern":
        """The pattern of the paper: one 2 x 2 Bayer block in the top left corner of each K x K
        tile.
        """
        if order not in BAYER_ORDERS:
            known = f"one of {', '.join(BAYER_ORDERS)}"
            raise InputError(f"pattern: unknown Bayer order {order!r}; {known}")
        return cls.with_block((order[:2], order[2:]), period, origin)

    @classmethod
    def with_block(
        cls, block: tuple[str, ...], period: int, origin: Pair = (0, 0), channels: str = ""
    ) -> "CfaPattern":
        """A pattern with `block` (rows of letters) in the top left corner of its tile, panchromatic
        elsewhere.
        """
        if period not in PERIODS:
            expected = f"expected {PERIODS[0]} to {PERIODS[-1]}"
            raise InputError(f"pattern: the period is {period}, {expected}")
        rows = [row + PANCHROMATIC * (period - len(row)) for row in block]
        return cls((*rows, *[PANCHROMATIC * period] * (period - len(block))), origin, channels)

    @classmethod
    def of_letters(cls, letters: str, origin: Pair = (0, 0), channels: str = "") -> "CfaPattern":
        """The pattern of a tile written row by row, or that of a name in `shared.tiles`.

        Parameters
        ----------
        letters : str
            Rows separated by "/" or lines, in which blanks do not count, or else by blanks. A tile
            that is not square, or too small, is repeated.

        Raises
        ------
        InputError
            That lists the names for a text that is neither.

        Examples
        --------
        >>> from panchroma.shared import CfaPattern
        >>> CfaPattern.of_letters("RG/BW").tile
        ('RGRG', 'BWBW', 'RGRG', 'BWBW')
        >>> CfaPattern.of_letters("kodak").tile
        ('WBWG', 'BWGW', 'WGWR', 'GWRW')
        """
        text = (letters_of(letters) or letters).strip()
        rows = ["".join(row.split()) for row in re.split(r"/|\s*\n\s*", text)]
        if len(rows) == 1:
            rows = text.split() or rows
        suggestion = "" if PANCHROMATIC in "".join(rows) else meant(letters, TILES)
        if suggestion or not re.fullmatch("[A-Z]+", "".join(rows)):
            raise InputError(f"pattern: {letters!r} is not {EXPECTED}{suggestion}")
        width = len(rows[0])
        if any(len(row) != width for row in rows) or not width:
            remedy = "a tile is written row by row, such as RGWW/GBWW/WWWW/WWWW"
            raise InputError(f"pattern: the rows of {letters!r} differ in length; {remedy}")
        side = lcm(len(rows), width)
        side *= -(-PERIODS[0] // side)
        if side not in PERIODS:
            repeats = f"a tile of {len(rows)} x {width} letters repeats in squares of {side}"
            raise InputError(f"pattern: {repeats}; at most {PERIODS[-1]} is possible")
        tile = [row * (side // width) for row in rows] * (side // len(rows))
        return cls(tuple(tile), origin, channels)

    @classmethod
    def from_json(cls, document: Any) -> "CfaPattern":
        """Return the pattern in a JSON object with "tile", "origin" and "channels".

        Raises
        ------
        InputError
            For anything else.

        Examples
        --------
        >>> from panchroma.shared import CfaPattern
        >>> CfaPattern.from_json({"tile": ["RGW", "GBW", "WWW"]}) == CfaPattern.bayer(3)
        True
        """
        try:
            fields = {"origin": (0, 0), "channels": "", **document}
            row, column = (whole("pattern: origin", value) for value in fields["origin"])
            are_texts = all(isinstance(text, str) for text in [*fields["tile"], fields["channels"]])
            if fields.keys() != {"tile", "origin", "channels"} or not are_texts:
                raise TypeError
        except InputError:
            raise
        except (TypeError, ValueError, KeyError):
            reason = f"{shown(document)} is not an object with tile, origin and channels"
            raise InputError(f"pattern: {reason}") from None
        return cls(tuple(fields["tile"]), (row, column), fields["channels"])

    @property
    def name(self) -> str:
        """Name of the tile, wherever it begins, from `shared.tiles`; "" if it has none."""
        name, _ = place_of(self.tile)
        return "" if name in CLEAR and self.derived is None else name

    @property
    def period(self) -> int:
        """K, the number of pixels from one block's origin to the next."""
        return len(self.tile)

    @cached_property
    def derived(self) -> int | None:
        """The channel without a filter, which follows from Eq. 7; None = every channel has one."""
        letters = "".join(self.tile)
        return next((i for i, letter in enumerate(self.channels) if letter not in letters), None)

    @cached_property
    def site_counts(self) -> IndexArray:
        """Number of sites of each channel in a block, (C,)."""
        return np.bincount([channel for *_, channel in self.sites], minlength=len(self.channels))

    @property
    def planes(self) -> str:
        """Letters of all filter planes: the channels, then panchromatic."""
        return self.channels + PANCHROMATIC

    @cached_property
    def is_scattered(self) -> bool:
        """True if the tile is the block: its colour sites do not form a small one, with
        panchromatic rows and columns around it.
        """
        return any(self._colour.any(axis).all() for axis in (0, 1)) or not self._is_connected

    @cached_property
    def block_origin(self) -> Pair:
        """Sensor (row, column) of the top left pixel of a block, each in 0..K-1."""
        (row, _), (column, _) = self._spans
        return (row + self.origin[0]) % self.period, (column + self.origin[1]) % self.period

    @cached_property
    def block_shape(self) -> Pair:
        """Size (rows, columns) of the rectangle around the colour sites of a block; (2, 2) for a
        Bayer block.
        """
        (_, rows), (_, columns) = self._spans
        return rows, columns

    @property
    def block_middle(self) -> Pair:
        """Sensor (row, column) of a pixel in the middle of a block, at which a patch begins."""
        (row, column), (down, across) = self.block_origin, self.block_shape
        return row + down // 2, column + across // 2

    @cached_property
    def sites(self) -> tuple[tuple[int, int, int], ...]:
        """(row, column, channel index) of each colour site of a block, counted from the block's
        origin.
        """
        block = self.filter_map(self.block_shape, first=self.block_origin)
        places = np.argwhere(block < len(self.channels)).tolist()
        return tuple((row, column, int(block[row, column])) for row, column in places)

    def light_efficiency(self, colour: float = 1.0) -> float:
        """Light collected, relative to a Bayer sensor, if a panchromatic pixel collects 3 times as
        much as a pixel of that sensor, and a colour pixel `colour` times as much.
        """
        share = len(self.sites) / self.period**2
        return 3 * (1 - share) + colour * share

    def filter_map(self, shape: Pair, first: Pair = (0, 0)) -> ByteArray:
        """Plane index of every pixel, uint8 `shape`: i for channel i, C for panchromatic. `first`:
        the sensor pixel at [0, 0].
        """
        (height, width), (top, left) = shape, np.subtract(first, self.origin)
        rows, columns = np.arange(height) + top, np.arange(width) + left
        return self._tile_planes[:, columns % self.period][rows % self.period]

    @cached_property
    def lattices(self) -> tuple[tuple[int, slice, slice], ...]:
        """(channel index, rows, columns) per colour site of a block: slices that select all its
        repetitions in any frame.
        """
        period, (down, across) = self.period, self.block_origin
        return tuple(
            (channel, *np.s_[(down + row) % period :: period, (across + column) % period :: period])
            for row, column, channel in self.sites
        )

    def panchromatic_mask(self, shape: Pair, first: Pair = (0, 0)) -> BoolArray:
        """Omega_L, the pixels where luminance is measured directly: bool `shape`. `first`: the
        sensor pixel at [0, 0].
        """
        return self.filter_map(shape, first) == len(self.channels)

    def letters_from(self, first: Pair = (0, 0)) -> tuple[str, ...]:
        """The K x K letters from sensor pixel `first` on: the tile with its origin applied."""
        square = self.filter_map((self.period, self.period), first)
        return tuple("".join(self.planes[plane] for plane in row) for row in square.tolist())

    def cropped(self, top: int, left: int) -> "CfaPattern":
        """The pattern of a mosaic cut out at pixel (top, left) of this one."""
        return CfaPattern(self.tile, (self.origin[0] - top, self.origin[1] - left), self.channels)

    def grid(self, shape: Pair) -> BlockGrid:
        """The blocks and K x K patches of a frame of `shape`.

        Raises
        ------
        InputError
            When no whole block lies inside.
        """
        return BlockGrid(self.period, self.block_origin, self.block_shape, shape)

    @cached_property
    def _tile_planes(self) -> ByteArray:
        return np.array([[*map(self.planes.index, row)] for row in self.tile], np.uint8)

    @cached_property
    def _colour(self) -> BoolArray:
        return self._tile_planes != len(self.channels)

    @cached_property
    def _spans(self) -> tuple[tuple[int, int], ...]:
        """(first, number) of the rows, and of the columns, of a block in the tile; where that is
        the tile, it begins as the tile of its name does, or a mirror image of that.
        """
        if self.is_scattered:
            for down, across in MIRRORS:
                name, first = place_of(tuple(row[::across] for row in self.tile[::down]))
                if name:
                    starts = down * first[0] % self.period, across * first[1] % self.period
                    return tuple((start, self.period) for start in starts)
            return (0, self.period), (0, self.period)
        return tuple(_span(np.asarray(self._colour.any(axis))) for axis in (1, 0))

    @property
    def _is_connected(self) -> bool:
        """True if the colour sites of a tile are connected, also diagonally and across the edge of
        the tile.
        """
        reached = np.zeros_like(self._colour)
        reached[tuple(np.argwhere(self._colour)[0])] = True
        for _ in range(int(self._colour.sum())):  # each step reaches the neighbours
            reached = self._colour & _spread(reached, 1)
        return bool((reached == self._colour).all())

    def _check_sites(self) -> None:
        period, tile = self.period, self._tile_planes
        for divisor in range(PERIODS[0], period):
            repeats = all((tile == np.roll(tile, divisor, axis)).all() for axis in (0, 1))
            if period % divisor == 0 and repeats:
                smallest = "/".join(row[:divisor] for row in self.tile[:divisor])
                remedy = f"give the smallest tile that repeats: {smallest}"
                raise InputError(f"pattern: the tile repeats every {divisor} pixels; {remedy}")
        far = self._colour & ~_spread(~self._colour, _FARTHEST)
        if self.is_scattered and far.any():
            row, column = np.argwhere(far)[0].tolist()
            site = f"the colour site in row {row + 1}, column {column + 1} of the tile"
            lacks = f"no panchromatic pixel (W) within {_FARTHEST} pixels of {site}"
            raise InputError(f"pattern: {lacks}: luminance there would be a guess")


def _span(occupied: BoolArray) -> Pair:
    """(start, length) of the shortest run on a ring that covers all True entries."""
    (places,) = np.nonzero(occupied)
    gaps = np.diff(places, append=places[0] + occupied.size)
    widest = int(np.argmax(gaps))
    return int(places[(widest + 1) % places.size]), occupied.size - int(gaps[widest]) + 1


def _spread(mask: BoolArray, reach: int) -> BoolArray:
    """The True places of a repeating tile, and all places at most `reach` rows and columns from
    them.
    """
    steps = range(-reach, reach + 1)
    moved = [np.roll(mask, (down, right), (0, 1)) for down in steps for right in steps]
    return np.logical_or.reduce(moved)
