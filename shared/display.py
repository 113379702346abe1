"""From camera RGB to the colours of a screen or an editor: white balance, colour matrix, transfer curve.

**White.** A white surface reads k * neutral, for some k. Display white is the brightest such reading that every channel can still
measure: its largest channel is 1.0 scene unit, the white level. (Raw developers state the inverse: white-balance multipliers,
scaled so that the smallest is 1.) For display each channel is clipped at its reading of that white, or, with a negative exposure,
at its reading of the brighter white that is shown then.

**Burnt out.** What the shot could not measure is white, whatever the exposure: a highlight that is darkened would otherwise end in
a flat grey, with a hard edge. A picture whose highlights are restored (`offline/highlights.py`) measures white up to where that
channel saturates in which it reads least; only what comes near that in every channel is burnt out, and what lies between colour
blocks, so that its light is lost (`ColourTransform.whitened`). In any other picture, such as one by the paper's method, luminance
stops where panchromatic samples saturate, and colour is wrong there. All of it changes gradually.

**Colour.** `SensorCalibration.camera_to_xyz` maps scene units to XYZ (D50) under the light of the neutral. A fitted matrix maps the
neutral only nearly to D50 white; a Bradford adaptation corrects the rest, so that k * neutral becomes grey, R = G = B. Without a
matrix, channels named R, G and B are assumed to have the primaries of sRGB, whatever others there are, which do not count then;
without these three there is no such guess.

**Curve.** The one of IEC 61966-2-1 and nothing else: no tone curve. "linear-srgb" has no clip, no curve, and keeps what is burnt
out. The space "camera" of the commands means unchanged samples; this module is not involved.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .arrays import CACHED, ByteArray, DoubleArray, FloatArray, strips
from .calibration import SensorCalibration
from .colorimetry import (
    BRADFORD,
    D50,
    P3_PRIMARIES,
    SRGB_PRIMARIES,
    Matrix,
    adaptation,
    as_rows,
    encode_srgb,
    nominal_to_xyz,
    primaries_to_xyz,
)
from .errors import InputError

MAX_EXPOSURE = 16.0
# Fractions of what the shot could measure between which a place turns white. Restored highlights: its colour samples end there by
# a shoulder of 5 %, and where all of them are saturated light is restored to within a few per cent. Otherwise: saturated samples
# are even, but for noise; the camera's preview does the same (`device/graph.py`).
_RESTORED = 0.70, 0.93
SATURATED = 0.90, 0.99


@dataclass(frozen=True)
class OutputSpace:
    """An RGB space with D65 white.

    name: key of `SPACES` and of the argument space.
    title: name for people and ICC profiles.
    primaries: chromaticities (x, y) of red, green and blue.
    linear: no transfer curve; otherwise that of sRGB.
    """

    name: str
    title: str
    primaries: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    linear: bool = False

    @cached_property
    def to_xyz(self) -> DoubleArray:
        """Matrix from linear RGB to XYZ relative to D50, float64 (3, 3); its columns are those of the ICC profile."""
        return primaries_to_xyz(self.primaries)


SPACES = {
    space.name: space
    for space in (
        OutputSpace("srgb", "sRGB", SRGB_PRIMARIES),
        OutputSpace("display-p3", "Display P3", P3_PRIMARIES),
        OutputSpace("linear-srgb", "Linear sRGB", SRGB_PRIMARIES, linear=True),
    )
}


@dataclass(frozen=True)
class ColourTransform:
    """The transform from the scene units of one sensor to one output space.

    space: the output space.
    white: reading of display white in each channel, scene units; the largest is 1.0.
    matrix: 3 x C, scene units -> linear RGB of the space; maps `white` to (1, 1, 1).
    brightest: the brightest white that some colour sample measures, in units of display white.
    weights: of each channel in a panchromatic sample, as a fraction of the light at which that saturates; None = highlights are
        restored.
    """

    space: OutputSpace
    white: tuple[float, ...]
    matrix: Matrix
    brightest: float
    weights: tuple[float, ...] | None = None

    @classmethod
    def to_space(cls, calibration: SensorCalibration, name: str = "srgb", *, restored: bool = True) -> "ColourTransform":
        """The transform for pictures of this sensor.

        name: a key of `SPACES`.
        restored: the pictures' highlights are restored from the colour samples, or nothing in them is clipped.
        A missing neutral is taken to be the reading that the matrix maps to D50, without a matrix (1, 1, 1).
        Raises InputError for an unknown space, for channels of unknown colours, and when the matrix maps the neutral to no possible
        white.
        """
        if name not in SPACES:
            raise InputError(f"unknown output space {name!r}; there are {', '.join(SPACES)}")
        space = SPACES[name]
        to_xyz = _camera_to_xyz(calibration)
        neutral = np.linalg.lstsq(to_xyz, D50)[0] if calibration.neutral is None else np.array(calibration.neutral)
        coloured = to_xyz.any(axis=0)
        neutral = np.where(coloured, neutral, neutral[coloured].max())  # channels without a colour do not count
        white = neutral / neutral.max()
        seen = to_xyz @ white
        if min(white) <= 0 or min(BRADFORD @ seen) <= 0:
            raise InputError(
                f"calibration: camera_to_xyz maps the white reading {_figures(white)} to XYZ {_figures(seen)}, which is no colour "
                'of light; calibrate again, or use `space="camera"`'
            )
        matrix = np.linalg.solve(space.to_xyz, adaptation(seen) @ to_xyz)
        weights = None if restored else tuple(weight / calibration.full_scale for weight in calibration.gamma)
        return cls(space, tuple(white.tolist()), as_rows(matrix), calibration.full_scale / float(white.min()), weights)

    def whitened(self, rgb: FloatArray, lost: ByteArray | None) -> FloatArray:
        """A picture in which what is lost is burnt out, for display; a linear one stays as it is.

        rgb: (H, W, C), scene units.
        lost: (H, W), how far the shot does not show what the light was, 255 = not at all; None = nowhere.
        """
        if lost is None or self.space.linear or not lost.any():
            return rgb
        brightest = np.array(self.white, np.float32) * np.float32(self.brightest)
        places, result = lost > 0, rgb.copy()
        result[places] += (lost[places, None] / np.float32(255)) * (brightest - rgb[places])
        return result

    def saturated(self, rgb: FloatArray) -> ByteArray | None:
        """How far each pixel is saturated, for `whitened`: uint8 (H, W), 255 = quite; None if none is, or highlights are restored.

        rgb: (H, W, C), scene units.
        """
        share = None if self.weights is None else self._burnt_out(rgb.transpose(2, 0, 1), 1.0)
        return None if share is None else np.rint(255 * share).astype(np.uint8)

    def apply(self, rgb: FloatArray, exposure: float = 0.0) -> FloatArray:
        """Transform a picture in scene units (H, W, C) to the space (H, W, 3), float32: 0..1 for display, unclipped when linear.

        exposure: stops of gain, -16 to 16. Negative values bring back highlights as far as the picture holds them; what is burnt
            out stays white.
        Raises InputError for an exposure beyond these limits, and for a picture that `checked_picture` refuses.
        """
        result = np.empty((*rgb.shape[:2], 3), np.float32)
        for rows, output, plane in self.planes(rgb, exposure):
            np.add(plane, 0, out=result[rows, :, output])  # there is no -0
        return result

    def planes(self, rgb: FloatArray, exposure: float = 0.0) -> Iterator[tuple[slice, int, FloatArray]]:
        """The result of `apply` in pieces that fit in the processor's cache: yield (rows, channel, float32 (rows, W))."""
        for rows, output, plane in self.light(rgb, exposure):
            yield rows, output, plane if self.space.linear else encode_srgb(plane)

    def light(self, rgb: FloatArray, exposure: float = 0.0) -> Iterator[tuple[slice, int, FloatArray]]:
        """As `planes`, before the transfer curve; beyond 0..1 the curve clips."""
        rgb = checked_picture(rgb, len(self.white))
        check_exposure(exposure)
        darker, brighter = 2.0 ** min(exposure, 0.0), 2.0 ** max(exposure, 0.0)
        matrix = (np.array(self.matrix) * brighter).astype(np.float32)
        white = np.array(self.white, np.float32)[:, None, None]
        # Planes: NumPy takes three times as long for channels that lie side by side.
        for rows in strips(len(rgb), max(1, CACHED // rgb.shape[1])):
            planes = np.array(rgb[rows].transpose(2, 0, 1), order="C")  # a copy, even of one pixel: it is changed in place
            burnt = None if self.space.linear else self._burnt_out(planes, darker)
            if darker != 1:
                planes *= np.float32(darker)
            if burnt is not None:
                planes += burnt * white
            if not self.space.linear:
                # The lower clip, -white, is far below any noise and prevents overflow. A clip at 0 would tint noisy shadows.
                # What is burnt out is clipped higher: its chromaticity is wrong, and may be negative.
                np.clip(planes, -white if burnt is None else (2 * burnt - 1) * white, white, out=planes)
            product = np.empty_like(planes[0])
            for output, weights in enumerate(matrix):
                plane: FloatArray = weights[0] * planes[0]
                for weight, each in zip(weights[1:], planes[1:], strict=True):
                    plane += np.multiply(weight, each, out=product)
                yield rows, output, plane

    def _burnt_out(self, planes: FloatArray, darker: float) -> FloatArray | None:
        """How far each pixel of (C, rows, W), scene units, is not what the light was, 0 to 1; None: it is, or is white anyway.

        darker: factor by which the picture is darkened, at most 1.
        """
        if self.weights is None and darker * self.brightest >= 1:
            return None
        first, last = _RESTORED if self.weights is None else SATURATED
        if self._level(planes.max(axis=(1, 2))) <= np.float32(first):  # the level grows with every channel
            return None
        return ((self._level(planes) - np.float32(first)) / np.float32(last - first)).clip(0, 1)

    def _level(self, planes: FloatArray) -> FloatArray:
        """Light (C, ...), scene units, as a fraction of what the shot could measure."""
        if self.weights is None:
            level: FloatArray = planes[0] / np.float32(self.white[0] * self.brightest)
            for plane, white in zip(planes[1:], self.white[1:], strict=True):
                level = np.minimum(level, plane / np.float32(white * self.brightest))
        else:
            level = np.float32(self.weights[0]) * planes[0]
            for plane, weight in zip(planes[1:], self.weights[1:], strict=True):
                level = level + np.float32(weight) * plane
        return level


def check_exposure(exposure: float) -> None:
    """Raise InputError unless the exposure, in stops, is within -16 to 16."""
    if not abs(exposure) <= MAX_EXPOSURE:
        raise InputError(f"exposure is {exposure} stops, expected -{MAX_EXPOSURE:g} to {MAX_EXPOSURE:g}")


def checked_picture(rgb: NDArray[np.floating], channels: int) -> FloatArray:
    """The picture as float32. Raises InputError unless it is (H, W, channels), floating point, not empty and finite."""
    if rgb.ndim != 3 or rgb.shape[2] != channels or 0 in rgb.shape:
        raise InputError(f"a picture of shape {rgb.shape}, expected (rows, columns, {channels})")
    if not np.issubdtype(rgb.dtype, np.floating):
        raise InputError(f"a picture of {rgb.dtype}, expected floating-point scene units")
    if bad := sum(int(np.count_nonzero(~np.isfinite(rgb[rows]))) for rows in strips(len(rgb))):
        raise InputError(f"{bad} of {rgb.size} values of the picture are not finite (NaN or infinite)")
    return rgb.astype(np.float32, copy=False)


def _camera_to_xyz(calibration: SensorCalibration) -> DoubleArray:
    """Matrix from scene units to XYZ (D50): the measured one, or that of sRGB primaries; float64 (3, C)."""
    channels = calibration.channels
    if calibration.camera_to_xyz is not None:
        return np.array(calibration.camera_to_xyz)
    if not set("RGB") <= set(channels):
        raise InputError(
            f"no colour matrix for the channels {channels}: calibrate the camera (panchroma calibrate), "
            'or render with `space="camera"`, as tif, exr or npy'
        )
    return nominal_to_xyz(channels, calibration.neutral)


def _figures(values: DoubleArray) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"
