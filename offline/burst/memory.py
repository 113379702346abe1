"""How much memory a burst needs, so that a program can refuse one before it starts."""

from shared.mosaic import Mosaic

from ..memory import rendering_memory
from ..settings import BEST, RenderSettings

# Bytes per pixel, measured at 3 and 12 megapixels and rounded up: of each frame (luminance, agreement, colour samples) and besides
# (what compares one frame with the reference).
_FRAME, _REST = 13.0, 97.0
_SAMPLE = 130.0  # bytes, of each colour sample of a frame: where these are scattered they are many, otherwise those are in `_FRAME`


def burst_memory(frames: int, mosaic: Mosaic, settings: RenderSettings = BEST) -> int:
    """An upper estimate, in bytes, of what merging and rendering a burst needs in addition to the program and the mosaics.

    frames: their number. mosaic: one of them.

    >>> import numpy as np
    >>> from offline.burst import burst_memory
    >>> from shared import CfaPattern, Mosaic, SensorCalibration
    >>> mosaic = Mosaic(np.zeros((600, 900), np.uint16), CfaPattern.bayer(6), SensorCalibration())
    >>> 50e6 < burst_memory(8, mosaic) < 300e6
    True
    """
    pixels, pattern = mosaic.shape[0] * mosaic.shape[1], mosaic.pattern
    frame = _FRAME + (_SAMPLE * len(pattern.sites) / pattern.period**2 if pattern.is_scattered else 0)
    return round(frame * frames * pixels + max(_REST * pixels, rendering_memory(mosaic, settings)))
