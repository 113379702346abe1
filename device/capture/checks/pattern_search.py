"""Finding the filter pattern in the samples of a frame: the period and the place at which samples are darker than their neighbours.

A colour filter passes a part of the light that its panchromatic neighbours receive, so the colour sites are darker wherever there
is light. Folding a frame with the right period puts all blocks on one place, where their differences add up, while scene and noise
average out. With another period, or in rows that do not line up, nothing adds up.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from shared.arrays import CodeArray, DoubleArray, FloatArray
from shared.pattern import PERIODS, CfaPattern

_SIDE = range(16, 65)  # pixels: side of a tile; four blocks of the largest period fit into the largest
_TILES = 64  # enough for a frame of any size, and folded in a tenth of a second
_WINDOW = 17  # pixels, along the squares of local means
_FLAT = 0.25  # codes: differences below this are rounding
_LIMIT = 4.0  # mean deviations: the edges of a scene count no more than this
_CERTAIN = 6.0  # standard errors
_FEW = 8  # tiles: with so few the standard error is itself uncertain, and among 1,500 places twice as many are asked for
_BETTER = 1.5  # the best place explains this many times the variance that the next one does; in photographs 2.7 times and more
_FAR = 4.0  # times as much is explained where filters are than where they were; blocks that overlap by half explain a tenth
_GROUP, _MOST_GROUPS = 12, 4  # tiles at least, beside each other, of which each group is judged
_PLAIN_ELSEWHERE = 0.03  # part of the variance that filters elsewhere explain at least: half of what is plain in a whole frame
_BAYER = 2
_NOTHING = 1e-9  # what rounding leaves of stripes without the means of their rows and columns


@dataclass(frozen=True)
class Found:
    """Where the colour sites are.

    period: K; 2 for an ordinary Bayer sensor.
    block_origin: sensor (row, column) of the top left pixel of a block, each 0 to K - 1; (0, 0) for period 2.
    places: `block_origin` and all other places at which the colour sites would be the same; scattered ones have several.
    explained: part of the variance of the samples, about their local mean, that this explains.
    sure: whether it is certain even if it was not expected here, one place among many that were tried.
    """

    period: int
    block_origin: tuple[int, int]
    places: frozenset[tuple[int, int]]
    explained: float
    sure: bool

    def fits(self, pattern: CfaPattern) -> bool:
        """Whether they are where `pattern` has them."""
        return self.period == pattern.period and pattern.block_origin in self.places


@dataclass(frozen=True)
class Tiles:
    """Parts of a frame, evenly spread. parts: float32 (N, S, S). places: sensor (row, column) of each, (N, 2)."""

    parts: FloatArray
    places: NDArray[np.intp]

    @classmethod
    def of(cls, codes: CodeArray, side: int = 0, most: int = _TILES) -> "Tiles":
        """Cut at most about that many tiles out of a frame (H, W). side: of a tile, pixels; 0 = one that suits the frame."""
        side = side or min(max(min(codes.shape) // 3, _SIDE[0]), _SIDE[-1], *codes.shape)
        share = min(1.0, (most * side**2 / codes.size) ** 0.5)
        tops, lefts = (np.linspace(0, size - side, max(int(size // side * share), 1)).astype(np.intp) for size in codes.shape)
        places = np.array([(top, left) for top in tops for left in lefts])
        return cls(np.stack([codes[top : top + side, left : left + side] for top, left in places]).astype(np.float32), places)

    def flattened(self, window: int = _WINDOW) -> "Tiles":
        """The samples minus their local mean, in local mean deviations, limited: every part of the scene counts the same.

        window: pixels along the squares of local means.
        """
        rest = self.parts - _local_mean(self.parts, window)
        rest /= _local_mean(np.abs(rest), window) + np.float32(_FLAT)
        return Tiles(rest.clip(-_LIMIT, _LIMIT), self.places)

    def quarter(self, down: int, right: int) -> "Tiles":
        """The upper (0) or lower (1), left or right quarter of each."""
        half = self.parts.shape[1] // 2
        top, left = down * half, right * half
        return Tiles(self.parts[:, top : top + half, left : left + half], self.places + np.array((top, left)))

    def folded(self, period: int) -> DoubleArray:
        """Mean of the samples of each tile at each place of a K x K square, minus the mean of all places: (N, K, K)."""
        down, across = _averages(self.parts.shape[1], period)[self.places.T % period]
        means = down @ self.parts @ across.transpose(0, 2, 1)
        return means - means.mean(axis=(1, 2), keepdims=True)


@lru_cache(maxsize=64)  # a search for the layout of a frame folds a hundred readings of it
def _averages(side: int, period: int) -> DoubleArray:
    """Weights of a tile's rows in the mean at each place of a period: (phase of the first row, place, row), (K, K, `side`)."""
    of_place = np.arange(side) % period == np.arange(period)[:, None]
    shifted = np.stack([of_place[np.arange(period) - phase] for phase in range(period)])
    return shifted / shifted.sum(axis=2, keepdims=True)


def find_pattern(codes: CodeArray, pattern: CfaPattern) -> Found | None:
    """Find a block of colour sites of this shape, at any period, or scattered sites at theirs; None if no place is certain.

    codes: a frame, (H, W).
    pattern: the expected pattern.
    """
    # `identify` expects no pattern, but replaces neither this nor `alike`: of nine patterns at four places in four lights it finds
    # none in frames of 64 x 96 pixels, and three quarters in 96 x 128, where this finds all; and it takes 60 to 100 ms where this
    # takes 4 to 14 (`alike`: 0.5). A wrong layout is found among more than a hundred readings.
    tiles = Tiles.of(codes).flattened()
    variance = float(np.square(tiles.parts).mean())
    if len(tiles.parts) < 4 or not variance:  # the spread over the tiles is what certainty is measured by
        return None
    certain, rival = [], 0.0
    if not pattern.is_scattered:  # every other pixel may be a scattered site
        bayer, certainty = _bayer(tiles)
        if certainty > _CERTAIN:
            certain.append((bayer / variance, _BAYER, [(0, 0)], certainty))
    for period in [pattern.period] if pattern.is_scattered else PERIODS:
        if period > tiles.parts.shape[1]:
            continue
        block = _block(pattern, period)
        explained, certainties = _explained(tiles.folded(period), block)
        place = np.unravel_index(int(explained.argmax()), explained.shape)
        best, certainty = float(explained[place]) / variance, float(certainties[place])
        places = [(int(place[0]), int(place[1]))]
        if pattern.is_scattered:
            places = _alike(block, places[0])
        explained[tuple(np.transpose(places))] = 0.0
        rival = max(rival, float(explained.max()) / variance)
        if certainty > _CERTAIN:
            certain.append((best, period, places, certainty))
        else:
            rival = max(rival, best)
    if not certain:
        return None
    # A Bayer sensor has no place where 2 x 2 samples are darker; a scene of fine checks may have its period as well.
    certain = [each for each in certain if each[1] != _BAYER] or certain
    *others, (best, period, places, certainty) = sorted(certain)
    rival = max([rival, *(each[0] for each in others)])
    sure = certainty > _CERTAIN * (1 + _FEW / len(tiles.parts))
    return Found(period, places[0], frozenset(places), best, sure) if best > _BETTER * rival else None


def is_elsewhere(tiles: Tiles, pattern: CfaPattern) -> bool | None:
    """Whether colour sites are at another place than those of `pattern`, whose period they have; None if the tiles do not show it.

    They are where some columns of the frame show them elsewhere: where pixels are lost, only a part may be in another row.

    Where they are elsewhere, the place of the pattern shows hardly anything: whatever a scene repeats, its filters are seen, too.
    """
    order = np.argsort(tiles.places[:, 1], kind="stable")
    flat, groups = tiles.flattened(), max(min(len(order) // _GROUP, _MOST_GROUPS), 1)
    folded = flat.folded(pattern.period)
    shown = [_are_elsewhere(flat.parts[group], folded[group], pattern) for group in np.array_split(order, groups)]
    return True if True in shown else False if False in shown else None


def _are_elsewhere(flat: FloatArray, folded: DoubleArray, pattern: CfaPattern) -> bool | None:
    """See `is_elsewhere`. flat, folded: of some tiles."""
    if len(flat) < 4:
        return None
    block = _block(pattern, pattern.period)
    explained, certainties = _explained(folded, block)
    ours = tuple(np.transpose(places_alike(pattern, pattern.block_origin)))
    here, certain_here = float(explained[ours].max()), float(certainties[ours].max())
    explained[ours] = 0.0
    place = np.unravel_index(int(explained.argmax()), explained.shape)
    there, certain_there = float(explained[place]), float(certainties[place])
    if certain_here > _CERTAIN and here > _BETTER * there:
        return False
    explained[tuple(np.transpose(places_alike(pattern, (int(place[0]), int(place[1])))))] = 0.0
    sure = certain_there > _CERTAIN * (1 + _FEW / len(flat)) and there > _PLAIN_ELSEWHERE * float(np.square(flat).mean())
    return True if sure and there > _BETTER * float(explained.max()) and there > _FAR * here else None


@lru_cache(maxsize=8)
def _steps(pattern: CfaPattern) -> tuple[tuple[int, int], ...]:
    """The steps by which colour sites can move and be where others were; (0, 0) is the first."""
    return tuple(_alike(_block(pattern, pattern.period), (0, 0)))


def places_alike(pattern: CfaPattern, place: tuple[int, int]) -> list[tuple[int, int]]:
    """`place`, and all others at which the colour sites would be the same."""
    return [((place[0] + down) % pattern.period, (place[1] + right) % pattern.period) for down, right in _steps(pattern)]


def _block(pattern: CfaPattern, period: int) -> DoubleArray:
    """1 at the colour sites, if they had this period, (K, K)."""
    block = np.zeros((period, period))
    for row, column, _ in pattern.sites:
        block[row % period, column % period] = 1.0
    return block


def _alike(block: DoubleArray, place: tuple[int, int]) -> list[tuple[int, int]]:
    """`place`, and all other places at which the block would have its sites where it has them there."""
    period, every = len(block), np.ndindex(block.shape)
    steps = (step for step in every if np.array_equal(np.roll(block, step, (0, 1)), block))
    return [((place[0] + down) % period, (place[1] + right) % period) for down, right in steps]


def _explained(folded: DoubleArray, block: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """Variance that a block explains at each place, (K, K), 0 where it is not darker; its contrast in standard errors.

    block: 1 at the colour sites, (K, K).
    """
    period = len(block)
    if block.all():
        return np.zeros((period, period)), np.zeros((period, period))
    contrasts, certainties = [], []
    # Once as it is, and once without the means of rows and columns, so that stripes of the same period are not taken for blocks.
    for means, model in ((folded, block - block.mean()), (_centred(folded), _centred(block))):
        if np.square(model).sum() < _NOTHING:
            continue
        around = np.tile(means, (1, 2, 2))
        here = [around[:, row : row + period, column : column + period] for row, column in np.argwhere(block)]
        contrast = sum(here) / np.square(model).sum()
        contrasts.append(mean := contrast.mean(axis=0))
        certainties.append(mean / (contrast.std(axis=0, ddof=1) / len(contrast) ** 0.5 + 1e-3))
    darker = np.maximum(-np.max(contrasts, axis=0), 0.0)
    filled = block.mean()
    return darker**2 * filled * (1 - filled), -np.max(certainties, axis=0)


def _bayer(tiles: Tiles) -> tuple[float, float]:
    """Variance that the difference between the diagonals of 2 x 2 pixels explains, and that difference in standard errors."""
    diagonals = (tiles.folded(_BAYER) * ((1, -1), (-1, 1))).mean(axis=(1, 2))
    error = diagonals.std(ddof=1) / len(diagonals) ** 0.5 + 1e-3
    return float(diagonals.mean() ** 2), float(abs(diagonals.mean()) / error)


def _centred(means: DoubleArray) -> DoubleArray:
    return (
        means - means.mean(axis=-1, keepdims=True) - means.mean(axis=-2, keepdims=True) + means.mean(axis=(-1, -2), keepdims=True)
    )


def _local_mean(parts: FloatArray, window: int) -> FloatArray:
    before = min(window // 2, parts.shape[1] - 2)
    after = before - 1 + window % 2
    wide = np.pad(parts, ((0, 0), (before + 1, after), (before + 1, after)), "reflect")
    sums = wide.cumsum(axis=1, dtype=np.float64)
    sums.cumsum(axis=2, out=sums)
    size = before + after + 1
    box = sums[:, size:, size:] - sums[:, :-size, size:] - sums[:, size:, :-size] + sums[:, :-size, :-size]
    return (box / size**2).astype(np.float32)
