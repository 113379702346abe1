"""How much memory the stages need, so that a program can refuse a frame before it starts."""

from shared.mosaic import Mosaic

from .rows.learned import model_for, rows_held
from .rows.pinning import rows_pinned
from .rows.refinement import reach
from .settings import BEST, RenderSettings
from .tiling import bands

# Bytes, measured at 1 to 100 megapixels and rounded up (`tests/tools/rendering/test_checks.py` measures again).
_PLANES = 9.0  # per pixel of the frame: samples in scene units, luminance, what replaces them, and where light is lost
_BLOCK_SITE = 55.0  # per colour site, while the chromaticities of the blocks are estimated
_BAND, _BAND_CHANNEL = 48.0, 28.0  # per pixel of a band (four fields), and per channel of it (the same rows at several stages)
_SITE = 10.0  # per colour site, kept until the picture is finished: samples and their noise
_HELD = 9.0  # per pixel of the rows that `finish` holds, and per channel of them: before and after the network
_PINNED, _PINNED_CHANNEL = 29.0, 12.0  # per pixel of the rows that `Pinning` holds, and per channel of them
_NETWORK = 90 * 2**20  # with its runtime and the tiles that are at work


def rendering_memory(mosaic: Mosaic, settings: RenderSettings = BEST) -> int:
    """An upper estimate, in bytes, of what `render_bands` needs in addition to the program, the mosaic and the picture.

    >>> import numpy as np
    >>> from offline import rendering_memory
    >>> from shared import CfaPattern, Mosaic, SensorCalibration
    >>> mosaic = Mosaic(np.zeros((600, 900), np.uint16), CfaPattern.bayer(6), SensorCalibration())
    >>> 30e6 < rendering_memory(mosaic) < 300e6
    True
    """
    (height, width), pattern = mosaic.shape, mosaic.pattern
    period, look = pattern.period, reach(pattern.period, settings.refinement)
    sites = len(pattern.sites) * height * width / period**2
    highest = max(band.patches[1] - band.patches[0] for band in bands(pattern.grid(mosaic.shape), look)) * period + 2 * look
    band = (_BAND + _BAND_CHANNEL * len(pattern.channels)) * min(highest, height) * width
    held = 0.0
    if settings.learned.used and (network := model_for(pattern)):
        held = _NETWORK + _HELD * (1 + len(pattern.channels)) * min(rows_held(network, period), height) * width
    if settings.sites.corrected and pattern.is_scattered:
        held = (_PINNED + _PINNED_CHANNEL * len(pattern.channels)) * min(highest + rows_pinned(period), height) * width
    return round(_PLANES * height * width + max(_BLOCK_SITE * sites, _SITE * sites + band + held))
