"""Frames have to measure luminance, in scene units, whose white is about 1, and every picture is
checked to be finite.

Stages have thresholds in scene units, such as the luminance below which a pixel has no colour:
samples in another unit would give a wrong picture without a word.
"""

from collections.abc import Sequence
from math import frexp

import numpy as np

from ..shared import FloatArray, InputError, Mosaic
from ..shared.errors import RangeError
from ..shared.figures import shown
from .settings import RenderSettings

_FARTHEST = 2.0**10
"""Times white, or a fraction of it: the brightest sample of a frame in scene units lies within."""


def check_frames(mosaics: Sequence[Mosaic], settings: RenderSettings) -> None:
    """Raise InputError for frames without a panchromatic pixel, for those of floating point that
    are not in scene units, and for settings that are none.

    The message says by what to scale the latter. Codes always are: their calibration says what they
    mean, and a lens cap makes frames as dark as can be. So a dark frame is taken if its brightest
    sample is half a code of its sensor, and a black one too.
    """
    if not isinstance(settings, RenderSettings):
        raise InputError(f"settings is {shown(settings)}, expected RenderSettings, such as PAPER")
    for mosaic in mosaics:
        (height, width), period = mosaic.shape, mosaic.pattern.period
        if not mosaic.pattern.panchromatic_mask((min(height, period), min(width, period))).any():
            frame = f"a frame of {width} x {height} pixels without a panchromatic one"
            raise InputError(f"{frame} does not measure luminance; use a larger one")
    white, step = mosaics[0].calibration.full_scale, mosaics[0].calibration.scale().min() / 2
    ends = [(mosaic.samples.min(), mosaic.samples.max()) for mosaic in mosaics]
    brightest, least = float(np.abs(ends).max()) / white, min(1 / _FARTHEST, step / white)
    codes = any(mosaic.samples.dtype == np.uint16 for mosaic in mosaics)
    if brightest and not codes and not least <= brightest <= _FARTHEST:
        found = f"{brightest:.2g} times white, expected {least:.2g} to {_FARTHEST:g} in scene units"
        remedy = f"multiply the samples, and their noise, by {2.0 ** -frexp(brightest)[1]:.3g}"
        raise InputError(f"the brightest sample is {found}; {remedy}")


def check_finite(picture: FloatArray, first: int) -> None:
    """Raise RangeError if a value of a band of a picture, (rows, W, C), is not finite.

    Parameters
    ----------
    first : int
        The frame's row that is its first.
    """
    finite = np.isfinite(picture)
    if not finite.all():
        wrong = np.argwhere(~finite.all(axis=2))
        found = f"{len(wrong)} pixels of the picture are not finite (NaN or infinite)"
        place = f"the first in row {first + wrong[0, 0]}, column {wrong[0, 1]}"
        remedy = "this is a fault of the render: please report the shot and the settings"
        raise RangeError(f"{found}, {place}; {remedy}")
