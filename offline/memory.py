"""How much memory the stages need, so that a program can refuse a frame before it starts."""

from shared.mosaic import Mosaic

from .learned import model_for, rows_held
from .refinement import reach
from .settings import BEST, RenderSettings
from .tiling import bands

# Bytes, measured at 1 to 100 megapixels and rounded up (`tests/tools/rendering/test_picture_file.py` measures again).
_PLANES = 9.0  # per pixel of the frame: samples in scene units, luminance, and what replaces them
_BLOCK = 220.0  # per colour block, while their chromaticities are estimated
_BAND, _BAND_CHANNEL = 48.0, 28.0  # per pixel of a band (four fields), and per channel of it (the same rows at several stages)
_SITE = 40.0  # per colour block, kept until the picture is finished: samples and their noise
_HELD = 9.0  # per pixel of the rows that `finish` holds, and per channel of them: before and after the network
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
    count = height * width / period**2
    highest = max(band.patches[1] - band.patches[0] for band in bands(pattern.grid(mosaic.shape), look)) * period + 2 * look
    band = (_BAND + _BAND_CHANNEL * len(pattern.channels)) * min(highest, height) * width
    held = 0.0
    if settings.learned.used and (network := model_for(pattern)):
        held = _NETWORK + _HELD * (1 + len(pattern.channels)) * min(rows_held(network, period), height) * width
    return round(_PLANES * height * width + max(_BLOCK * count, _SITE * count + band + held))
