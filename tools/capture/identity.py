"""Finding the filters of a sensor that nobody described, from one frame.

The frame is cut into square windows, and each window is folded: the mean is taken at each place of
a K x K tile. What the scene does differs from window to window; what the filters do is the same in
all. Energies are products of means from opposite quarters of a window, which share no sample and
hardly an edge: on average noise and scene add nothing to them.

The smallest period that explains what any period does is that of the filters. Panchromatic sites
are the brightest. Sites of one colour read the same, whatever the colour of the scene; sites of
different colours do not. Which of two colours is red and which is blue a mosaic does not tell: a
picture of something known does.
"""

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import combinations, compress, product
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...device.capture.windows import Windows
from ...shared import BoolArray, CodeArray, DoubleArray, InputError
from ...shared.pattern import PANCHROMATIC, PERIODS, CfaPattern
from ...shared.tiles import CLEAR, TILES, place_of

DENSE = {
    "Bayer": "RG/GB",
    "quad Bayer": "RRGG/RRGG/GGBB/GGBB",
    "X-Trans": "GBGGRG/RGRBGB/GBGGRG/GRGGBG/BGBRGR/GRGGBG",
}
"""Name -> letters, row by row, of the usual tiles that have no panchromatic pixel."""
COMPARED = (
    *("RGWW/BWWW/WWWW/WWWW", "GRWW/WBWW/WWWW/WWWW", "BWWW/RGWW/WWWW/WWWW", "WBWW/GRWW/WWWW/WWWW"),
    "RWGW/WWWW/GWBW/WWWW",
    *(f"{block}/WWWWWW/WWWWWW/WWWWWW/WWWWWW" for block in ("VRGWWW/NUGWWW", "GRVWWW/GUNWWW")),
)
"""Letters of tiles without a name that the pages compare, and of their mirror images: these stand
for a name.
"""
UNKNOWN = "?"
"""Letter of a colour that a frame does not tell."""
_PERIODS = range(2, PERIODS[-1] + 1)
_WINDOWS, _FEW = 256, 8  # at most: more show nothing new; at least: the spread of fewer is unknown
_SMALLEST = 32  # pixels along a window; and four periods, so that a quarter has two
_WIDTH = 17  # pixels, about, of local means: whole periods
# standard errors, for one period among fifteen; energy: filters show 0.015 and more, scenes 0.001
_CERTAIN, _LEAST_ENERGY = 5.0, 0.005
# A longer period has to explain this share more, by so many standard errors: in each window, or in
# what all have in common. In photographs scenes reach 5 and 9; filters 10 and more in one of both.
_SHARE, _MORE, _COMMON = 4e-4, 6.0, 10.0
_GAP = 0.2  # of the range of all sites, between panchromatic ones and others
# standard errors by which the colours of a tile without panchromatic sites have to differ
_SURE = 4.0
_DOUBT = 1.0  # standard errors from which on sites may have different colours
_BETTER = 3.0  # standard errors by which the best of a few tiles has to be better than any other
# times the energy by which sites of one kind differ; in photographs 7 times and more where there is
# light
_APART = 3.0
# Of tiles without panchromatic sites. In six camera RAWs and eight photographs with noise up to
# 0.03: 61 times and more; where two of four different filters (CYGM, RGBW) are taken for one: at
# most 25.
_DENSE_APART = 40.0
# of the energy between the brightest sites and others: different filters have 0.015 and more, the
# same 0.002
_UNLIKE = 0.005
_SAME = 0.03  # three clear sites in four are less unlike: small frames of Bayer sensors are more
# Change of clear sites over the mean of the two others: in eight photographs 2.2 and more, for they
# see both and a third. Green sites of 14 RAWs and photographs: 1.3 to 2.3.
_ALL_LIGHT = 2.1
# Of the range of clear sites: what others read more there, at most; in eight photographs less than
# nothing. A strong red or blue in front of a Bayer sensor: 0.07 to 0.6.
_BEYOND = 0.01
# letters of three kinds, the one with most sites first, or which both others resemble: of the three
# spectra green is in the middle (36 of 36 pictures, noise up to 0.03). No frame tells the others.
_THREE_COLOURS = "GRB"
_MORE_COLOURS = "CDEFHIJK"

Letters = NDArray[np.str_]


@dataclass(frozen=True)
class Identity:
    """Filter pattern that a frame shows.

    Attributes
    ----------
    tile : tuple[str, ...]
        K strings of K letters, K = 2 to 16, from the first pixel of the frame on. W is
        panchromatic, "?" a colour that the frame does not tell. If red and blue have equally many
        sites, the tile with both exchanged would fit as well. Without a name the letters only say
        which sites are alike.
    name : str
        The tile's in `shared.tiles`, one of DENSE, or one of COMPARED; "" if it has none.
    certainty : float
        Energy of what repeats with the period, in standard errors; more than 5.
    light : DoubleArray
        Mean of each site minus what is around it, in mean local deviations, float64 (K, K).
    """

    tile: tuple[str, ...]
    name: str
    certainty: float
    light: DoubleArray


def describe(tile: Sequence[str]) -> tuple[str, tuple[int, int]] | None:
    """Name, or letters, and origin of the pattern with these letters from the first pixel on; None
    if one is unknown, or if Panchroma cannot use the tile.
    """
    with suppress(InputError):
        pattern = CfaPattern.of_letters("/".join(tile))
        name, origin = place_of(pattern.tile)
        first = origin if name else pattern.block_origin
        return name.casefold() or "/".join(pattern.letters_from(first)), first
    return None


def identify(codes: CodeArray, windows: int = _WINDOWS) -> Identity | None:
    """Find the filters of the sensor that took a frame; None if the frame shows no pattern.

    The brightest sites are taken for panchromatic if they read the same, and in a tile without a
    name a sum of the others, unless the tile is one of DENSE. Of tiles with the same panchromatic
    sites the colours decide; where they do not, they are "?".

    Parameters
    ----------
    codes : CodeArray
        (H, W), of any size and with any black and white level. Colours show in a scene that has
        several; the larger the period, the larger the frame has to be.
    windows : int, optional
        Of the frame that are looked at, at most: with fewer it is quicker, and less certain.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.tools.capture.identity import identify
    >>> identify(np.full((300, 400), 512, np.uint16)) is None
    True
    """
    folds = _Folds(codes, windows)
    if (repeating := _find_period(folds)) is None:
        return None
    period, certainty = repeating
    quarters = folds.quarters(period)
    levels = quarters.mean(axis=(0, 1)).reshape(period, period)
    if np.diff(np.sort(levels, axis=None)).max() < _GAP * np.ptp(levels):
        return None
    errors, share = _unlike(quarters, _bright(levels).ravel())
    alike = errors < _SURE or share < _UNLIKE
    name, letters = "", np.full(levels.shape, UNKNOWN)
    if named := _find_named(folds, levels, alike):
        name, letters = named
    elif alike:
        kinds = _join_sites(quarters, levels, folds.levels(period))
        if UNKNOWN in kinds or _is_sum(folds.levels(period), kinds.ravel()):
            letters = kinds
    if name == "Bayer" and _sees_all_light(folds.levels(period), (letters == "G").ravel()):
        name, letters = CLEAR[0], np.where(letters == "G", PANCHROMATIC, letters)
    same = alike and share < _SAME
    if not name and same and period == 2 and (bright := _bright(levels)).sum() == 3:
        name, letters = CLEAR[2], np.where(bright, PANCHROMATIC, "R")
    times = len(letters) // period
    tile = tuple("".join(row) for row in letters.tolist())
    return Identity(tile, name, certainty, np.tile(levels, (times, times)))


def facts_of(codes: CodeArray) -> dict[str, Any]:
    """Identify the filter pattern of a frame (H, W), see `Identity`; `pattern` and `alternatives`
    are those that fit.

    Raises InputError that says what to photograph if the frame shows no pattern.
    """
    identity = identify(codes)
    if identity is None:
        raise InputError(
            "the frame shows no pattern of filters: it is too dark, too even or too small, or "
            "there are none. Photograph something with many colours in good light, not "
            "overexposed; the larger the frame the better"
        )
    tile = identity.tile
    clear = [[letter == PANCHROMATIC for letter in row] for row in tile]
    return {
        "period": len(tile),
        "certainty": round(identity.certainty, 1),
        "panchromatic": np.argwhere(clear).tolist(),
        "letters": list(tile),
        "name": identity.name or None,
        "light": identity.light.round(4).tolist(),
        "pattern": describe(tile),
        "alternatives": list(filter(None, map(describe, _exchange_colours(tile)))),
    }


def _exchange_colours(tile: tuple[str, ...]) -> list[tuple[str, ...]]:
    """The tiles that would fit as well: red and blue with equally many sites are exchanged. Two
    colours among clear sites are red, and blue or green.
    """
    sites = Counter("".join(tile))
    if sites.keys() == {PANCHROMATIC, "R", "B"} and len(tile) == 2:
        pairs = ("BR", "RG", "GR")
        return [tuple(row.translate(str.maketrans("RB", pair)) for row in tile) for pair in pairs]
    exchanged = tuple(row.translate(str.maketrans("RB", "BR")) for row in tile)
    return [exchanged] if sites["R"] == sites["B"] > 0 else []


class _Folds:
    """A frame, cut into windows of the size that a period needs, and folded with it.

    periods: those for which the frame has enough windows.
    """

    def __init__(self, codes: CodeArray, windows: int) -> None:
        counts = (prod(size // _side(period) for size in codes.shape) for period in _PERIODS)
        self.periods = list(compress(_PERIODS, (count >= _FEW for count in counts)))
        self._windows = cache(lambda side: Windows.of(codes, side, windows))
        self._flat = cache(lambda side, window: self._windows(side).flattened(window))

    def levels(self, period: int) -> DoubleArray:
        """Mean of each window at each place of a tile, codes: (windows, K K)."""
        return self._windows(_side(period)).levels(period).reshape(-1, period**2)

    def quarters(self, period: int, large: int = 0) -> DoubleArray:
        """Means of each window's four quarters at each place of a tile, less the mean of all
        places: (windows, 4, K K).

        large: the windows are as large as this period needs; 0 = as this one.
        """
        large = large or period
        flat = self._flat(_side(large), large * max(round(_WIDTH / large), 1))
        folded = [flat.quarter(*place).folded(period) for place in product((0, 1), repeat=2)]
        return np.stack(folded, axis=1).reshape(len(folded[0]), 4, period**2)


def _side(period: int) -> int:
    """Pixels along a window."""
    return max(_SMALLEST, 4 * period)


def _find_period(folds: _Folds) -> tuple[int, float] | None:
    """The smallest period that explains what any does, and its certainty in standard errors; None
    if none is certain.
    """
    energies = {period: _common(folds.quarters(period)) for period in folds.periods}
    strong = [period for period in energies if energies[period].mean() > _LEAST_ENERGY]
    certain = [period for period in strong if _errors(energies[period]) > _CERTAIN]
    if not certain:
        return None
    likely = max(certain, key=lambda period: float(energies[period].mean()))
    divisors = (period for period in energies if likely % period == 0)
    best = next(period for period in divisors if not _explains_more(folds, likely, period))
    longer = (period for period in energies if period > best and period % best == 0)
    best = next((period for period in longer if _explains_more(folds, period, best)), best)
    return (best, _errors(energies[best])) if best in certain else None


def _explains_more(folds: _Folds, longer: int, shorter: int) -> bool:
    """True if a period certainly explains something that one of its divisors does not, in the same
    windows.
    """
    more, less = folds.quarters(longer), folds.quarters(shorter, large=longer)
    for energy, least in ((_energy, _MORE), (_common, _COMMON)):
        gain = energy(more) - energy(less)
        if _errors(gain) > least and float(gain.mean()) > _SHARE * float(energy(more).mean()):
            return True
    return False


def _find_named(folds: _Folds, light: DoubleArray, alike: bool) -> tuple[str, Letters] | None:
    """Name and letters (K, K) of the tile with a name that fits best; None if none does.

    alike: whether the brightest sites may be panchromatic.

    Its period may be a multiple of the one that was found: in a checkerboard of panchromatic sites
    little else may show.
    """
    period = len(light)
    likely: dict[str, Letters] = {}
    for side in (side for side in folds.periods if alike and side % period == 0):
        repeated = np.tile(light, (side // period, side // period))
        fitting = _known_tiles(folds.levels(side), _bright(repeated))
        if best := _choose_best(folds.quarters(side), fitting, sure=side > period):
            return best
        if side == period:
            likely = dict(fitting)
    dense = _known_tiles(folds.levels(period), np.zeros(light.shape, np.bool_))
    if best := _choose_best(folds.quarters(period), dense, sure=True, least=_DENSE_APART):
        return best
    if len(likely) != 1:
        return None
    ((name, tile),) = likely.items()
    return name, np.where(tile == PANCHROMATIC, PANCHROMATIC, UNKNOWN)


def _choose_best(
    quarters: DoubleArray, tiles: Sequence[tuple[str, Letters]], sure: bool, least: float = _APART
) -> tuple[str, Letters] | None:
    """The tile whose sites of a colour read most alike; None if another one may be it as well, or
    if colours differ less than `least` times as much as sites of one colour do.

    tiles: names and letters; of two in which the same sites are alike the first counts.
    sure: all colours have to differ for certain.
    """
    kinds = {(tile[..., None, None] == tile).tobytes(): (name, tile) for name, tile in tiles[::-1]}
    spreads = [(_spread(quarters, tile.ravel()), name, tile) for name, tile in kinds.values()]
    spreads.sort(key=lambda scored: float(scored[0].mean()))
    if not spreads or any(_errors(other - spreads[0][0]) < _BETTER for other, *_ in spreads[1:]):
        return None
    _, name, tile = spreads[0]
    return (name, tile) if _separation(quarters, tile.ravel(), sure) > least else None


def _known_tiles(levels: DoubleArray, clear: BoolArray) -> list[tuple[str, Letters]]:
    """Name and letters of the tiles with panchromatic sites at these places (K, K); where three
    colours have equally many sites, those whose green is in the middle.

    levels: (windows, K K), mean of each window at each site.
    """
    period, number = len(clear), int(clear.sum())
    known = TILES | DENSE | dict(zip(COMPARED, COMPARED, strict=True))
    rows_of = [(name, known[name].split("/")) for name in known if name not in ("paper", *CLEAR)]
    if period in PERIODS and number == period**2 - 4:
        blocks = [CfaPattern.bayer(period, order).tile for order in ("RGGB", "GRBG")]
        rows_of += [(place_of(blocks[0])[0], [*tile]) for tile in blocks]
    tiles = []
    for name, rows in rows_of:
        if len(rows) != period or "".join(rows).count(PANCHROMATIC) != number:
            continue
        for step in np.ndindex(period, period):
            tile = np.roll([[*row] for row in rows], step, (0, 1))
            kinds = [tile.ravel() == letter for letter in _THREE_COLOURS]
            equal = len({*map(np.count_nonzero, kinds)}) == 1
            fits = np.array_equal(tile == PANCHROMATIC, clear)
            if fits and not (equal and _resemblance(levels, kinds).argmin()):
                tiles.append((name, tile))
    return tiles


def _resemblance(levels: DoubleArray, kinds: Sequence[NDArray[Any]]) -> DoubleArray:
    """Correlation of the two others, from window to window, for each of three kinds of sites: least
    for green.
    """
    means = [levels[:, kind].mean(axis=1) for kind in kinds]
    return np.asarray(np.corrcoef(means))[[1, 0, 0], [2, 2, 1]]


def _unlike(quarters: DoubleArray, bright: BoolArray) -> tuple[float, float]:
    """Return how unlike the brightest sites are, which one filter would make the same: the energy
    between them in standard errors, and as a share of that between them and the others.
    """
    within = _spread(quarters, np.where(bright, UNKNOWN, PANCHROMATIC))
    one, other = (quarters[..., kind].mean(axis=2, keepdims=True) for kind in (bright, ~bright))
    beside = _energy(one - other)
    return _errors(within), float(within.mean()) / max(float(beside.mean()), 1e-12)


def _is_sum(levels: DoubleArray, letters: Letters) -> bool:
    """True if panchromatic sites see the sum of the others: from window to window they read more,
    the more there is of each colour.

    Yellow ones, which can be as bright, read less where there is more cyan and as much of magenta
    and green.
    """
    names = (PANCHROMATIC, *_colours(letters))
    kinds = (levels[:, letters == name].mean(axis=1) for name in names)
    clear, *colours = (kind - kind.mean() for kind in kinds)
    return bool((np.linalg.lstsq(np.stack(colours, axis=1), clear)[0] > 0).all())


def _sees_all_light(levels: DoubleArray, sites: BoolArray) -> bool:
    """True if these sites see all light: from window to window they change `_ALL_LIGHT` times as
    much as the mean of the others, and in no window do others read more.
    """
    these, others = levels[:, sites].mean(axis=1), levels[:, ~sites]
    beyond = (others.max(axis=1) - these).max()
    changes_more = these.std() > _ALL_LIGHT * others.mean(axis=1).std()
    return bool(changes_more and beyond < _BEYOND * np.ptp(these))


def _join_sites(quarters: DoubleArray, light: DoubleArray, levels: DoubleArray) -> Letters:
    """Letters (K, K) of a tile without a name: as many kinds of colours as are certainly apart.

    Sites are joined, those that differ least first, until any two kinds differ more than
    panchromatic sites do. Where that is in doubt, all colours stay open.
    """
    bright, level = _bright(light).ravel(), light.ravel()
    letters = np.where(bright, PANCHROMATIC, UNKNOWN)
    usual = max(2 * float(_spread(quarters, np.where(bright, UNKNOWN, PANCHROMATIC)).mean()), 1e-6)
    sites = np.flatnonzero(~bright)
    apart = _differences(quarters)[np.ix_(sites, sites)]
    members = np.eye(len(sites), dtype=np.bool_)  # of groups, a row each
    while len(members) > 1:
        weights = members / members.sum(axis=1, keepdims=True)
        means = weights @ apart @ weights.T
        np.fill_diagonal(means, np.inf)
        first, second = sorted(np.unravel_index(int(means.argmin()), means.shape))
        nearest = _energy(quarters[..., sites] @ (weights[[first]] - weights[[second]]).T)
        separation = float(nearest.mean()) / usual
        if separation > 1 and _errors(nearest) > _DOUBT:
            if len(members) > len(_MORE_COLOURS) or separation < _APART or _errors(nearest) < _SURE:
                break
            names = _THREE_COLOURS if len(members) == len(_THREE_COLOURS) else _MORE_COLOURS
            groups = [sites[member] for member in members]
            rank = [-level[group].mean() for group in groups]
            if names == _THREE_COLOURS:
                rank = _resemblance(levels, groups).tolist()
            order = sorted(range(len(groups)), key=lambda kind: (-len(groups[kind]), rank[kind]))
            for letter, kind in zip(names, order, strict=False):
                letters[groups[kind]] = letter
            break
        members[first] |= members[second]
        members = np.delete(members, second, axis=0)
    return letters.reshape(light.shape)


def _separation(quarters: DoubleArray, letters: Letters, sure: bool) -> float:
    """By how many times more the two colours that are most alike differ than sites of one colour
    do.

    sure: 0 unless that is certain.
    """
    of_colours = (quarters[..., letters == letter] for letter in _colours(letters))
    kinds = (samples.mean(axis=2, keepdims=True) for samples in of_colours)
    energies = (_energy(first - second) for first, second in combinations(kinds, 2))
    apart = min(energies, key=lambda energy: float(energy.mean()))
    if sure and _errors(apart) < _SURE:
        return 0.0
    return float(apart.mean()) / max(2 * float(_spread(quarters, letters).mean()), 1e-6)


def _spread(quarters: DoubleArray, letters: Letters) -> DoubleArray:
    """Variance of the sites of a colour about their mean, in each window, (windows,)."""
    kinds = [quarters[..., letters == letter] for letter in _colours(letters)]
    residuals = np.concatenate([kind - kind.mean(axis=2, keepdims=True) for kind in kinds], axis=2)
    return _energy(residuals) * residuals.shape[2] / max(residuals.shape[2] - len(kinds), 1)


def _colours(letters: Letters) -> list[str]:
    return sorted({*letters.tolist()} - {PANCHROMATIC})


def _bright(light: DoubleArray) -> BoolArray:
    """The sites above the widest gap between the levels of sites."""
    levels = np.sort(light, axis=None)
    return light > levels[np.diff(levels).argmax()]


def _differences(quarters: DoubleArray) -> DoubleArray:
    """Energy of the difference of any two sites, (K K, K K)."""
    products = quarters[:, 0].T @ quarters[:, 3] + quarters[:, 1].T @ quarters[:, 2]
    products /= 2 * len(quarters)
    own = np.diag(products)
    return own[:, None] + own - products - products.T


def _common(quarters: DoubleArray) -> DoubleArray:
    """Energy that each window has in common with the mean of all others, (windows,)."""
    means = quarters.mean(axis=1)
    others = (means.sum(axis=0) - means) / (len(means) - 1)
    return (means * others).mean(axis=1)


def _energy(quarters: DoubleArray) -> DoubleArray:
    """Energy of each window without that of noise, (windows,): products of opposite quarters."""
    return (quarters[:, 0] * quarters[:, 3] + quarters[:, 1] * quarters[:, 2]).mean(axis=1) / 2


def _errors(energies: DoubleArray) -> float:
    """Mean of some energies in standard errors."""
    error = float(energies.std(ddof=1)) / len(energies) ** 0.5
    return float(energies.mean()) / error if error else 0.0
