"""Which of the scattered colour sites have which filter, as far as samples tell: those of one channel read the same.

The panchromatic pixels of a scattered pattern often lie as they do for several places of the tile: half of all pixels, as on a
checkerboard, leave only two. Colours tell these places apart.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from shared.arrays import BoolArray, CodeArray, DoubleArray
from shared.pattern import CfaPattern

from .block_order import exceeds
from .pattern_search import Tiles

_IMBALANCE = 0.03  # of the difference from panchromatic samples, by which sites of one channel may differ
_FEWEST = 8  # tiles: with fewer the uncertainty of their mean is unknown


def likely_place(codes: CodeArray, pattern: CfaPattern, places: Iterable[tuple[int, int]]) -> tuple[int, int] | None:
    """The place at which the tile begins: one at which the sites of a channel read the same; None where the frame does not show it.

    It is the declared one where nothing can tell: a place at which only channels are exchanged counts as the declared one (which is
    red, a chart tells), and so does every place if no channel has two sites.

    codes: a frame, (H, W), that shows the panchromatic pixels of the pattern.
    places: sensor (row, column) of the first pixel of a tile; panchromatic pixels are alike at all of them.
    """
    declared, *others = sorted(places, key=lambda place: (place != pattern.origin, place))
    groups = {_sharing(replace(pattern, origin=place)).tobytes(): place for place in (*others, declared)}
    if len(groups) == 1 or len(pattern.sites) == len(pattern.channels):
        return declared
    folded = Tiles.of(codes).flattened().folded(pattern.period)
    if len(folded) < _FEWEST:
        return None
    clear = replace(pattern, origin=declared).panchromatic_mask((pattern.period, pattern.period))
    contrast = folded[:, clear].mean(axis=1) - folded[:, ~clear].mean(axis=1)
    scene = folded[:, clear].var(axis=1, ddof=1) if clear.sum() > 1 else np.zeros(len(folded))
    energies = {place: _energy(folded, _sharing(replace(pattern, origin=place))) for place in groups.values()}
    best = min(energies, key=lambda place: float(energies[place].mean()))
    # What makes sites of one channel differ, the scene or the sensor, is at most as large as this.
    limit = np.maximum.reduce([energies[best], scene, np.square(_IMBALANCE * contrast)])
    rivals = [declared] if best != declared else [place for place in energies if place != best]
    return best if all(exceeds(energies[place], limit) for place in rivals) else None


def _sharing(pattern: CfaPattern) -> BoolArray:
    """Which of the first K x K pixels share a colour filter, bool (K K, K K); False for panchromatic ones."""
    planes = pattern.filter_map((pattern.period, pattern.period)).ravel()
    sharing: BoolArray = (planes[:, None] == planes) & (planes < len(pattern.channels))
    return sharing


def _energy(folded: DoubleArray, sharing: BoolArray) -> DoubleArray:
    """Variance, in each tile (N,), of the samples of sites that share a filter, about their mean."""
    sites = sharing.any(axis=1)
    samples, within = folded.reshape(len(folded), -1)[:, sites], sharing[np.ix_(sites, sites)]
    shares = within / within.sum(axis=1, keepdims=True)
    freedom = len(within) - float(np.trace(shares))
    energy: DoubleArray = np.square(samples - samples @ shares.T).sum(axis=1) / freedom
    return energy
