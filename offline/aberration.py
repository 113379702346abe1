"""Undo lateral chromatic aberration in the samples, before colour is estimated."""

from collections.abc import Iterable
from dataclasses import replace
from math import ceil

import numpy as np

from shared.aberration import Aberration
from shared.mosaic import Mosaic
from shared.progress import Progress

from .kernels.aberration import undo_aberration
from .kernels.mixing import colour
from .parts import Look, Part, windows


def without_aberration(mosaic: Mosaic, lens: Aberration, picture: Iterable[Part], progress: Progress) -> Mosaic:
    """The mosaic as it would be if its lens had no lateral chromatic aberration, which its calibration then does not name.

    lens: what its calibration says of it.
    picture: a first picture of it, rendered as if there were none, in scene units. It tells how much the displacement of channels
        changes each sample. What is not in that picture, such as noise, stays as it is.

    Samples that are saturated stay so, with those around them that their light reaches; none loses more than half of its light.
    """
    from scipy.ndimage import maximum_filter  # takes longer to load than all of ours

    planes, (height, _) = mosaic.pattern.filter_map((mosaic.pattern.period,) * 2), mosaic.shape
    radial, gamma = np.array(lens.radial), np.array(mosaic.calibration.gamma, np.float32)
    is_coded, reach = mosaic.samples.dtype == np.uint16, ceil(lens.reach(mosaic.shape))
    signal = mosaic.signal if is_coded else mosaic.signal.copy()
    signal.flags.writeable = True  # codes become a new array
    for part, (first, end) in windows(picture, height, Look(reach + 2)):
        shown, rows = np.empty_like(part.chromaticity), slice(first, end)
        colour(part.chromaticity, part.luminance, shown)
        changed = signal[rows].copy()
        undo_aberration(shown, part.first, height, radial, gamma, planes, first, changed)
        # Beside strong edges the first picture may be wrong by more than a dark sample, which would become a black dot.
        np.maximum(changed, np.minimum(signal[rows], signal[rows] / 2), out=changed)
        if is_coded:  # how bright and of which colour what is saturated is, is a guess, and would change what its light reaches
            around = slice(max(first - reach - 1, 0), end + reach + 1)
            saturated = maximum_filter(mosaic.samples[around] >= mosaic.calibration.white_level, 2 * reach + 3)
            np.copyto(changed, signal[rows], where=saturated[first - around.start :][: len(changed)])
        signal[rows] = changed
        progress.advance(end - first)
    signal.flags.writeable = False
    return replace(mosaic, samples=signal, calibration=replace(mosaic.calibration, aberration=None))
