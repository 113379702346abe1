"""From camera RGB to the colours of a screen or an editor: white balance, colour matrix, transfer
curve.

**White** and **colour** are those of `shared.display`. For display each channel is clipped at its
reading of display white, or,
with a negative exposure, at its reading of the brighter white that is shown then.

**Burnt out.** What the shot could not measure is white, whatever the exposure: a highlight that is
darkened would otherwise end in
a flat grey, with a hard edge. A picture whose highlights are restored
(`offline/stages/highlights.py`) measures white up to where
that channel saturates in which it reads least; only what comes near that in every channel is burnt
out, and what lies between
colour blocks, so that its light is lost (`ColourTransform.whitened`). In any other picture, such as
one by the paper's method,
luminance stops where panchromatic samples saturate, and colour is wrong there. All of it changes
gradually.

**Curve.** The one of IEC 61966-2-1 and nothing else: no tone curve. "linear-srgb" has no clip, no
curve, and keeps what is burnt
out, but for lost light, which is white. The space "camera" of the commands means unchanged samples,
but in a DNG, in which lost light is white, too.

**Samples of a file.** Integer codes, turned upright, in bands that are divided otherwise.
"""

import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...shared import InputError, OutputError, SensorCalibration
from ...shared.arrays import CACHED, ByteArray, CodeArray, DoubleArray, FloatArray, strips
from ...shared.colorimetry import SRGB_PRIMARIES, Matrix, as_rows, primaries_to_xyz
from ...shared.display import SATURATED, display_white
from ...shared.writing import reason
from .colour import P3_PRIMARIES, encode_srgb

MAX_EXPOSURE = 16.0
# Fractions of what the shot could measure between which a place of a picture with restored
# highlights turns white: its colour samples end there by a shoulder of 5 %, and where all of them
# are saturated light is restored to within a few per cent.
_RESTORED = 0.70, 0.93


@dataclass(frozen=True)
class OutputSpace:
    """An RGB space with D65 white.

    Attributes
    ----------
    title : str
        Name for people and ICC profiles.
    primaries : tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
        Chromaticities (x, y) of red, green and blue.
    linear : bool
        No transfer curve; otherwise that of sRGB.
    """

    title: str
    primaries: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    linear: bool = False

    @cached_property
    def to_xyz(self) -> DoubleArray:
        """Matrix from linear RGB to XYZ relative to D50, float64 (3, 3); its columns are those of
        the ICC profile.
        """
        return primaries_to_xyz(self.primaries)


SPACES = {
    "srgb": OutputSpace("sRGB", SRGB_PRIMARIES),
    "display-p3": OutputSpace("Display P3", P3_PRIMARIES),
    "linear-srgb": OutputSpace("Linear sRGB", SRGB_PRIMARIES, linear=True),
}


@dataclass(frozen=True)
class ColourTransform:
    """The transform from the scene units of one sensor to one output space.

    Attributes
    ----------
    space : OutputSpace
        The output space.
    white : tuple[float, ...]
        Reading of display white in each channel, scene units; the largest is 1.0.
    matrix : Matrix
        3 x C, scene units -> linear RGB of the space; maps `white` to (1, 1, 1).
    brightest : float
        The brightest white that some colour sample measures, in units of display white.
    weights : tuple[float, ...] | None
        Of each channel in a panchromatic sample, as a fraction of the light at which that
        saturates; None = highlights are restored.
    """

    space: OutputSpace
    white: tuple[float, ...]
    matrix: Matrix
    brightest: float
    weights: tuple[float, ...] | None = None

    @classmethod
    def to_space(
        cls, calibration: SensorCalibration, name: str = "srgb", *, restored: bool = True
    ) -> "ColourTransform":
        """The transform for pictures of this sensor.

        name: a key of `SPACES`. restored: the pictures' highlights are restored from the colour
        samples, or nothing in them is clipped. Raises InputError where `display_white` does.
        """
        white, matrix = display_white(calibration, SPACES[name].to_xyz)
        weights = tuple(weight / calibration.full_scale for weight in calibration.gamma)
        brightest = calibration.full_scale / float(white.min())
        known = SPACES[name], tuple(white.tolist()), as_rows(matrix), brightest
        return cls(*known, None if restored else weights)

    def whitened(self, rgb: FloatArray, lost: ByteArray | None, exposure: float) -> FloatArray:
        """A picture in which what is lost is white: as bright as it is, but at least so that a
        display shows white at this exposure.

        rgb: (H, W, C), scene units. lost: (H, W), how far the shot does not show what the light
        was, 255 = not at all; None = nowhere. Raises InputError as `apply` does.
        """
        check_exposure(exposure)
        if lost is None or not lost.any():
            return rgb
        white = np.array(self.white, np.float32)
        # what is brighter, `_burnt_out` makes white
        least = 1.0 if self.space.linear else min(2.0**-exposure, max(self.brightest, 1.0))
        places, result = lost > 0, rgb.copy()
        level = rgb[places].sum(axis=1, keepdims=True) / white.sum()
        burnt = white * np.maximum(level, np.float32(least))
        result[places] += (lost[places, None] / np.float32(255)) * (burnt - rgb[places])
        return result

    def saturated(self, rgb: FloatArray) -> ByteArray | None:
        """Saturation of each pixel, for `whitened`: uint8 (H, W), 255 = quite; None if none is, or
        highlights are restored.

        rgb: (H, W, C), scene units.
        """
        degree = None if self.weights is None else self._burnt_out(rgb.transpose(2, 0, 1), 1.0)
        return None if degree is None else np.rint(255 * degree).astype(np.uint8)

    def apply(self, rgb: FloatArray, exposure: float = 0.0) -> FloatArray:
        """Transform a picture in scene units (H, W, C) to the space (H, W, 3), float32: 0..1 for
        display, unclipped when linear.

        exposure: stops of gain, -16 to 16. Negative values bring back highlights as far as the
        picture holds them; what is burnt out stays white. Raises InputError for an exposure beyond
        these limits, and for a picture that `checked_picture` refuses.
        """
        result = np.empty((*rgb.shape[:2], 3), np.float32)
        for rows, output, plane in self.planes(rgb, exposure):
            np.add(plane, 0, out=result[rows, :, output])  # there is no -0
        return result

    def planes(
        self, rgb: FloatArray, exposure: float = 0.0, *, encoded: bool = True
    ) -> Iterator[tuple[slice, int, FloatArray]]:
        """Yield the result of `apply` in strips that fit in the processor's cache: (rows, channel,
        float32 (rows, W)).

        encoded: apply the transfer curve; without it values beyond 0..1 remain, which the curve
        clips.
        """
        rgb = checked_picture(rgb, len(self.white))
        check_exposure(exposure)
        darker, brighter = 2.0 ** min(exposure, 0.0), 2.0 ** max(exposure, 0.0)
        matrix = (np.array(self.matrix) * brighter).astype(np.float32)
        white = np.array(self.white, np.float32)[:, None, None]
        # Planes: NumPy takes three times as long for channels that lie side by side.
        for rows in strips(len(rgb), max(1, CACHED // rgb.shape[1])):
            # a copy, even of one pixel: it is changed in place
            planes = np.array(rgb[rows].transpose(2, 0, 1), order="C")
            burnt = None if self.space.linear else self._burnt_out(planes, darker)
            if darker != 1:
                planes *= np.float32(darker)
            if burnt is not None:
                planes += burnt * white
            if not self.space.linear:
                # The lower clip, -white, is far below any noise and prevents overflow. A clip at 0
                # would tint noisy shadows. What is burnt out is clipped higher: its chromaticity is
                # wrong, and may be negative.
                lowest = -white if burnt is None else (2 * burnt - 1) * white
                np.clip(planes, lowest, white, out=planes)
            product = np.empty_like(planes[0])
            for output, weights in enumerate(matrix):
                plane: FloatArray = weights[0] * planes[0]
                for weight, channel in zip(weights[1:], planes[1:], strict=True):
                    plane += np.multiply(weight, channel, out=product)
                is_encoded = encoded and not self.space.linear
                yield rows, output, encode_srgb(plane) if is_encoded else plane

    def _burnt_out(self, planes: FloatArray, darker: float) -> FloatArray | None:
        """Degree to which pixels of (C, rows, W), scene units, are not what the light was, 0 to 1.
        None: they are, or white anyway.

        darker: factor by which the picture is darkened, at most 1.
        """
        if self.weights is None and darker * self.brightest >= 1:
            return None
        first, last = _RESTORED if self.weights is None else SATURATED
        # the level grows with every channel
        if self._level(planes.max(axis=(1, 2))) <= np.float32(first):
            return None
        return ((self._level(planes) - np.float32(first)) / np.float32(last - first)).clip(0, 1)

    def _level(self, planes: FloatArray) -> FloatArray:
        """Return the light (C, ...), scene units, as a fraction of what the shot could measure."""
        if self.weights is None:
            limits = (np.float32(white * self.brightest) for white in self.white)
            return np.min(list(map(np.divide, planes, limits)), axis=0)
        return sum(map(np.multiply, map(np.float32, self.weights), planes))


def check_exposure(exposure: float) -> None:
    """Raise InputError unless the exposure, in stops, is within -16 to 16."""
    if not abs(exposure) <= MAX_EXPOSURE:
        expected = f"expected -{MAX_EXPOSURE:g} to {MAX_EXPOSURE:g}"
        raise InputError(f"exposure is {exposure} stops, {expected}")


def checked_picture(rgb: NDArray[np.floating], channels: int) -> FloatArray:
    """The picture as float32.

    Raises InputError unless it is (H, W, channels), floating point, not empty and finite.
    """
    if rgb.ndim != 3 or rgb.shape[2] != channels or 0 in rgb.shape:
        raise InputError(f"a picture of shape {rgb.shape}, expected (rows, columns, {channels})")
    if not np.issubdtype(rgb.dtype, np.floating):
        raise InputError(f"a picture of {rgb.dtype}, expected floating-point scene units")
    if bad := sum(int(np.count_nonzero(~np.isfinite(rgb[rows]))) for rows in strips(len(rgb))):
        counted = f"{bad} of {rgb.size} values of the picture"
        raise InputError(f"{counted} are not finite (NaN or infinite)")
    return rgb.astype(np.float32, copy=False)


_READ = 64  # rows read back at a time

Sample = TypeVar("Sample", bound=np.generic)


def quantise(encoded: FloatArray, bits: int) -> ByteArray | CodeArray:
    """Return the nearest of 2**bits codes for finite values of any shape, clipped to 0..1: uint8 (8
    bits) or uint16 (16).
    """
    codes = np.empty(encoded.shape, np.uint8 if bits == 8 else np.uint16)
    for rows in strips(len(encoded)):
        codes[rows] = np.rint(encoded[rows].clip(0.0, 1.0) * np.float32((1 << bits) - 1))
    return codes


def upright(picture: NDArray[Sample], orientation: int) -> NDArray[Sample]:
    """Return a view of the samples (H, W, ...) turned and mirrored by a TIFF orientation, 1 to 8
    (TIFF 6.0, tag 274).
    """
    if orientation >= 5:  # the stored rows are columns of the scene
        picture = picture.swapaxes(0, 1)
    # Direction of each axis after the swap.
    down = -1 if orientation in (3, 4, 7, 8) else 1
    across = -1 if orientation in (2, 3, 6, 7) else 1
    return picture[::down, ::across]


def display_codes(
    rgb: FloatArray, shown: ColourTransform, bits: int, exposure: float = 0.0
) -> NDArray[Any]:
    """`quantise(shown.apply(rgb, exposure), bits)`, by a few rows at a time that stay in the
    processor's cache.
    """
    codes = np.empty((*rgb.shape[:2], 3), np.uint8 if bits == 8 else np.uint16)
    for rows, channel, plane in shown.planes(rgb, exposure):
        codes[rows, :, channel] = quantise(plane, bits)
    return codes


def joined(bands: Iterable[NDArray[Sample]], rows: int) -> NDArray[Sample]:
    """The bands (any, ...) of a picture with this number of rows as one array; of each only its
    copy is kept.
    """
    arriving = iter(bands)
    first = next(arriving)
    whole, top = np.empty((rows, *first.shape[1:]), first.dtype), 0
    for band in chain([first], arriving):
        whole[top : top + len(band)] = band
        top += len(band)
    return whole


def regrouped(bands: Iterable[NDArray[Any]], rows: int) -> Iterator[NDArray[Any]]:
    """Yield the rows of `bands` in groups of `rows`; the last group may be smaller."""
    kept: list[NDArray[Any]] = []
    for band in bands:
        kept.append(band)
        while (count := sum(map(len, kept))) >= rows:
            together = np.concatenate(kept) if len(kept) > 1 else kept[0]
            whole = count // rows * rows
            yield from (together[top : top + rows] for top in range(0, whole, rows))
            kept = [together[whole:]]
    if any(map(len, kept)):
        yield np.concatenate(kept)


def turned(
    bands: Iterable[NDArray[Any]], shape: tuple[int, int], orientation: int, folder: Path
) -> Iterator[NDArray[Any]]:
    """Turn a picture of `shape` (H, W) upright: yield bands of the turned picture. An anonymous
    file in `folder` holds it.
    """
    if orientation in (1, 2):  # rows stay rows, in the same order
        yield from (upright(band, orientation) for band in bands)
        return
    with tempfile.TemporaryFile(dir=folder, buffering=0) as spool:
        for band in bands:
            left = np.ascontiguousarray(band).data.cast("B")
            try:
                while left:
                    left = left[spool.write(left) :]
            except OSError as error:
                why = reason(error, folder)
                raise OutputError(f"{folder}: no temporary file: {why}") from error
        for top in range(0, shape[1] if orientation >= 5 else shape[0], _READ):
            # Mapped again for each band: pages that have been read count as memory of the process
            # as long as they are mapped.
            whole = np.memmap(spool, band.dtype, "r", shape=(*shape, *band.shape[2:]))
            yield np.array(upright(whole, orientation)[top : top + _READ])
