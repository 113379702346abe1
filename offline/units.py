"""Extremely bright and dark frames are computed in units of their own, and every picture is checked to be finite.

Stages have thresholds in scene units, such as the luminance below which a pixel has no colour, and single precision has limits.
Both suit scenes whose white is 1. A frame of samples in scene units may be a million times darker, or brighter: it is rendered
multiplied by a power of two, which is exact, and the picture is divided by that.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import frexp

import numpy as np

from shared.arrays import FloatArray
from shared.errors import RangeError
from shared.mosaic import Mosaic

_USUAL = range(-5, 11)
"""Exponents of two of the brightest sample, relative to full scale, at which a frame is left as it is. Those of photographs are
around 0. In dark ones thresholds show: at 1/2000 of white, refinement changes edges of `paper` by a quarter of them (measured)."""


def own_unit(mosaics: Sequence[Mosaic]) -> int:
    """n, where 2^n scene units are a good unit for these frames: 0 if they have codes, or are neither very dark nor very bright.

    In that unit the brightest sample of all is a quarter to half of full scale.
    """
    if any(mosaic.samples.dtype == np.uint16 for mosaic in mosaics):
        return 0
    extremes = [(-float(mosaic.samples.min()), float(mosaic.samples.max())) for mosaic in mosaics]
    brightest = max(max(pair) for pair in extremes)
    _, exponent = frexp(brightest / mosaics[0].calibration.full_scale)
    return 0 if brightest == 0 or exponent in _USUAL else exponent + 1


def scaled(mosaic: Mosaic, exponent: int) -> Mosaic:
    """The mosaic, whose samples are in scene units, in units of 2^exponent scene units; for 0 the mosaic itself."""
    if exponent == 0:
        return mosaic
    noise = mosaic.calibration.noise
    if noise is not None:
        noise = noise.in_units_of(2.0**exponent).possible()
    samples = np.ldexp(mosaic.samples, -exponent)
    samples.flags.writeable = False
    return replace(mosaic, samples=samples, calibration=replace(mosaic.calibration, noise=noise))


def in_scene_units(light: FloatArray, exponent: int) -> FloatArray:
    """Light in units of 2^exponent scene units, in scene units; what single precision has no number for is its largest."""
    if exponent == 0:
        return light
    largest = np.finfo(np.float32).max
    with np.errstate(over="ignore"):
        return np.ldexp(light, exponent).clip(-largest, largest)


def check_finite(picture: FloatArray, first: int) -> None:
    """Raise RangeError if a value of a band of a picture, (rows, W, C), is not finite. first: the frame's row that is its first."""
    with np.errstate(over="ignore"):
        if np.isfinite(picture.sum()):
            return
    wrong = ~np.isfinite(picture).all(axis=2)
    if wrong.any():
        row, column = np.argwhere(wrong)[0].tolist()
        raise RangeError(
            f"{np.count_nonzero(wrong)} pixels of the picture are not finite (NaN or infinite), the first in row {first + row}, "
            f"column {column}; this is a fault of the render: please report the shot and the settings"
        )
