"""Correlation of the errors of a picture at the colour sites of a block: a model for the preview
and for the render.

What a picture misses at a site (sample minus picture, in the channel of its filter) is known there.
A stroke or an edge that passes through one site passes near the others, and is missed in all
channels: so what is missed at the sites of a block says what the picture's other errors there are.
The constants were chosen on photographs; twice or half of each changes little.
"""

import numpy as np

from .arrays import DoubleArray
from .pattern import CfaPattern


def nearness(pattern: CfaPattern) -> DoubleArray:
    """Correlation of the errors at two sites of a block, float64 (S, S): 0.35 to the power of their
    distance in pixels.

    Examples
    --------
    >>> from panchroma.shared import CfaPattern
    >>> from panchroma.shared.site_errors import nearness
    >>> nearness(CfaPattern.bayer(6))[0].round(2).tolist()  # beside, below, diagonal
    [1.0, 0.35, 0.35, 0.23]
    """
    place = np.array(pattern.sites)[:, :2]
    return 0.35 ** np.hypot(*np.moveaxis(place[:, None] - place, 2, 0))


def error_correlation(pattern: CfaPattern) -> tuple[DoubleArray, list[int]]:
    """Correlation of the errors of all C channels at all S sites, float64 (S C, S C), and where the
    S measured ones are among them.

    Channels are in units of luminance: each is multiplied by its gamma (Eq. 7).

    Examples
    --------
    >>> from panchroma.shared import CfaPattern
    >>> from panchroma.shared.site_errors import error_correlation
    >>> correlation, measured = error_correlation(CfaPattern.bayer(6))
    >>> correlation.shape, measured
    ((12, 12), [0, 4, 7, 11])
    """
    channels = len(pattern.channels)
    between = np.full((channels, channels), 0.4)  # of two channels at one pixel
    np.fill_diagonal(between, 1)
    measured = [site * channels + channel for site, (_, _, channel) in enumerate(pattern.sites)]
    return np.kron(nearness(pattern), between).astype(np.float64), measured
