"""Memory estimates, so that a program can refuse a frame before it starts."""

from ..shared.mosaic import Mosaic
from ..shared.networks import network_for
from .patches import band_rows
from .settings import BEST, RenderSettings

# Bytes, measured at 1 to 100 megapixels and rounded up (`tests/tools/batch/test_memory.py` measures
# again). per pixel of the frame: samples in scene units, luminance, what replaces them, `lost`
_PLANES = 9.0
_BLOCK_SITE = 60.0  # per colour site, while the chromaticities of the blocks are estimated
# while a network does that: per colour site, per block that it is given at once, and how many
_FOUND, _BLOCK, _BLOCKS = 64.0, 2300.0, 295e3
# per colour site, kept until the picture is finished: what is known of them
_SITE = 10.0
# Bytes per pixel of a band, for luminance and for each channel, while it goes through the stages in
# rows, by what is used of them: the paper's, the corrections at the sites, and the network
# for colour with the rows around that it sees.
_PAPER, _SITES, _LEARNED = 34.0, 14.0, 37.0
_NETWORK = 90 * 2**20  # bytes, with its runtime and the chunks that are at work


def rendering_memory(mosaic: Mosaic, settings: RenderSettings = BEST) -> int:
    """An upper estimate, in bytes, of what `render_bands` needs in addition to the program, the
    mosaic and the picture.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.offline import rendering_memory
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> mosaic = Mosaic(np.zeros((600, 900), np.uint16), CfaPattern.bayer(6), SensorCalibration())
    >>> 30e6 < rendering_memory(mosaic) < 300e6
    True
    """
    (height, width), pattern = mosaic.shape, mosaic.pattern
    sites = len(pattern.sites) * height * width / pattern.period**2
    learned = settings.learned.used and network_for(pattern) is not None
    held = _PAPER + _SITES * settings.correction.used + _LEARNED * learned
    band = max(end - first for first, end in band_rows(pattern.grid(mosaic.shape)))
    stages = held * (1 + len(pattern.channels)) * min(band, height) * width + _NETWORK * learned
    blocks = min(height * width / pattern.period**2, _BLOCKS) * settings.chromaticity.learned
    steps = _BLOCK_SITE * sites, _FOUND * sites + _BLOCK * blocks, _SITE * sites + stages
    return round(_PLANES * height * width + max(steps))
