"""Evidence in the samples of a frame that they are read as they were written, and that the colour filters are where they should be.

A colour filter passes a part of the light that its panchromatic neighbours receive: colour sites are darker wherever there is
light. Folding a frame with the period of the pattern adds up their differences, while scene and noise average out. In rows that do
not line up, or with another pattern, nothing adds up, or it does so elsewhere.
"""

from functools import lru_cache
from itertools import product

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.pattern import PERIODS, CfaPattern

from .tiles import Tiles

_CERTAIN = 6.0  # standard errors
_FEW = 8  # tiles: with so few standard errors and medians are uncertain; among many places twice as many errors are asked for
_BETTER = 1.5  # the best place explains this many times the variance that the next one does; in photographs 2.7 times and more
_FAR = 4.0  # times as much is explained where filters are than where they were; blocks that overlap by half explain a tenth
_GROUP, _MOST_GROUPS = 12, 4  # tiles at least, beside or below each other, of which each group is judged
_PLAIN = 0.03  # part of the variance that filters elsewhere explain at least: half of what is plain in a whole frame
_NOTHING = 1e-9  # what rounding leaves of stripes without the means of their rows and columns
_LIT = 0.03  # of the range of codes: a tile with less light says nothing of its filters
_CLIPPED = 1 / 16  # of the samples of a tile: with more of them colour sites seem brighter than they are
_AS_BRIGHT = 0.9  # relative to panchromatic pixels: colour sites that are brighter have no filter; median of tiles
_PAIRS = 200  # of neighbours: with fewer the rates at which their bits differ are unknown
# By so much more often may a bit of higher value differ than one of lower value. Of 120 random scenes of two levels, dots of 2 to
# 9 pixels, ten are above 0.25, and three above 0.4, all with dots of 2 pixels. Wrong packings are above.
_REVERSED = 0.4
_UNUSED = 0.01  # rate of a bit that holds nothing


def shows_filters(tiles: Tiles, pattern: CfaPattern) -> bool | None:
    """Return whether colour sites are where `pattern` has them; False: at another place, None: the tiles do not show it.

    Groups of tiles beside each other and below each other are judged, too: after a loss of pixels only a part is elsewhere.
    """
    flat = tiles.flattened()
    folded = flat.folded(pattern.period)
    groups = [np.arange(len(folded))]
    count = min(len(folded) // _GROUP, _MOST_GROUPS)
    if count > 1:
        for axis in (0, 1):
            groups += np.array_split(np.argsort(tiles.places[:, axis], kind="stable"), count)
    answers = [_are_in_place(flat.parts[group], folded[group], pattern) for group in groups]
    return False if False in answers else True if True in answers else None


def _are_in_place(flat: FloatArray, folded: DoubleArray, pattern: CfaPattern) -> bool | None:
    """See `shows_filters`. flat, folded: of some tiles."""
    if len(flat) < 4:
        return None
    explained, certainties = _explained(folded, _block(pattern, pattern.period))
    ours = tuple(np.transpose(places_alike(pattern, pattern.block_origin)))
    here, certain_here = float(explained[ours].max()), float(certainties[ours].max())
    explained[ours] = 0.0
    place = np.unravel_index(int(explained.argmax()), explained.shape)
    there, certain_there = float(explained[place]), float(certainties[place])
    if certain_here > _CERTAIN and here > _BETTER * there:
        return True
    # Where colour sites are elsewhere, the place of the pattern shows hardly anything, whatever the scene repeats.
    explained[tuple(np.transpose(places_alike(pattern, (int(place[0]), int(place[1])))))] = 0.0
    sure = certain_there > _CERTAIN * (1 + _FEW / len(flat)) and there > _PLAIN * float(np.square(flat).mean())
    return False if sure and there > _BETTER * float(explained.max()) and there > _FAR * here else None


def has_other_period(tiles: Tiles, pattern: CfaPattern) -> bool:
    """Return whether blocks of colour sites repeat at a part of the period of `pattern`, along an axis, or at twice the period."""
    flat, period = tiles.flattened(), pattern.period
    if pattern.is_scattered or len(flat.parts) < 4:
        return False

    def explained(period: int, row: int, column: int) -> tuple[DoubleArray, DoubleArray]:
        """Variance that blocks explain at every `row`-th row and `column`-th column from their own on; certainties."""
        places = tuple(np.roll(plane, np.negative(pattern.block_origin) % period, (0, 1)) for plane in folded[period])
        return places[0][::row, ::column], places[1][::row, ::column]

    folded = {each: _explained(flat.folded(each), _block(pattern, each)) for each in (period, 2 * period) if each in PERIODS}
    for part in (part for part in range(max(pattern.block_shape), period) if period % part == 0):
        for steps in ((part, period), (period, part)):
            values, certainties = explained(period, *steps)
            if certainties.min() > _CERTAIN and values.min() > values.max() / _BETTER:
                return True
    if 2 * period not in folded:
        return False
    values, certainties = explained(2 * period, period, period)
    *_, second, first = np.sort(values, axis=None)
    return bool(certainties.max() > _CERTAIN and first > max(_FAR * second, _PLAIN / 2 * float(np.square(flat.parts).mean())))


def lacks_filters(tiles: Tiles, pattern: CfaPattern, black: float, white: float) -> bool:
    """Return whether there is light, and the colour sites are as bright as panchromatic pixels in the same rows, or columns."""
    block = np.roll(_block(pattern, pattern.period), pattern.block_origin, (0, 1)) > 0
    levels = tiles.folded(pattern.period) + tiles.parts.mean(axis=(1, 2), keepdims=True) - black
    clear = levels[:, ~block].mean(axis=1)
    lit = (clear > _LIT * (white - black)) & ((tiles.parts >= white).mean(axis=(1, 2)) < _CLIPPED)
    if lit.sum() < _FEW:
        return False
    for axis in (0, 1):
        mixed = block.any(axis=axis, keepdims=True) & ~block.all(axis=axis, keepdims=True)
        sites, others = (levels[lit][:, kind & mixed].mean(axis=1) for kind in (block, ~block))
        if mixed.any() and np.median(sites / others) > _AS_BRIGHT:
            return True
    return False


def is_misread(tiles: Tiles, pattern: CfaPattern, pixels: int, bits: int) -> bool:
    """Return whether bits of high value differ more often between neighbours than bits of low value: those are in the wrong place.

    pixels: samples of a packed group, of which each may be wrong; 1 = words, whose lowest bits may be unused.
    bits: of a sample.
    """
    codes, clear = tiles.parts.astype(np.uint16), tiles.panchromatic(pattern)
    position = (tiles.places[:, 1, None] + np.arange(codes.shape[2])) % pixels
    rates = np.ones((pixels, bits))
    for axis, step in product((1, 2), (1, 2, pattern.period)):  # stripes of one width do not hide that neighbours are alike
        pairs = (clear & np.roll(clear, step, axis))[:, step:, step:]
        changed = (codes ^ np.roll(codes, step, axis))[:, step:, step:]
        for number in range(pixels):
            some = changed[pairs & (position == number)[:, None, step:]]
            if len(some) >= _PAIRS:
                rates[number] = np.minimum(rates[number], [(some >> bit & 1).mean() for bit in range(bits)])
    for row in rates:
        used = row[int((row > _UNUSED).argmax()) :] if pixels == 1 else row
        if (used - np.minimum.accumulate(used)).max() > _REVERSED:
            return True
    return False


@lru_cache(maxsize=8)
def _steps(pattern: CfaPattern) -> tuple[tuple[int, int], ...]:
    """Steps by which colour sites can move and be where others were; (0, 0) is the first."""
    block = _block(pattern, pattern.period)
    return tuple(step for step in np.ndindex(block.shape) if np.array_equal(np.roll(block, step, (0, 1)), block))


def places_alike(pattern: CfaPattern, place: tuple[int, int]) -> list[tuple[int, int]]:
    """Return `place`, and all others at which the colour sites would be the same."""
    return [((place[0] + down) % pattern.period, (place[1] + right) % pattern.period) for down, right in _steps(pattern)]


def _block(pattern: CfaPattern, period: int) -> DoubleArray:
    """1 at the colour sites, if they had this period, (K, K)."""
    block = np.zeros((period, period))
    for row, column, _ in pattern.sites:
        block[row % period, column % period] = 1.0
    return block


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


def _centred(means: DoubleArray) -> DoubleArray:
    return (
        means - means.mean(axis=-1, keepdims=True) - means.mean(axis=-2, keepdims=True) + means.mean(axis=(-1, -2), keepdims=True)
    )
