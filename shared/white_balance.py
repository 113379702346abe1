"""White balance: what white reads under the light of a shot, estimated where nobody has measured
it, and where it is clipped.

An estimate is an opinion on the scene, not a measurement of the sensor:
`SensorCalibration.neutral_estimated` marks it, and `panchroma inspect` says so.
"""

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from .arrays import DoubleArray, FloatArray, IndexArray
from .calibration import SensorCalibration, derived_channel
from .colorimetry import Matrix, as_rows, white_reading, xyz
from .errors import InputError
from .lights import illuminant_xy
from .mosaic import Mosaic

Real = TypeVar("Real", FloatArray, DoubleArray)

GREY_BOX = 9  # pixels, the sides of what `neutral_at` takes for grey
_MINKOWSKI = 6  # Finlayson and Trezzi, "Shades of Gray and Colour Constancy", CIC 2004
_DARK, _BRIGHT = 0.02, 0.95  # colours between these are above the noise and below clipping
# Natural logarithms of channels relative to each other. White under a lamp or the sky is this near
# to light of a black body or of day. What is far from it and greener is read by channels that the
# matrix does not describe: a picture that was never balanced.
_NEAR, _FAR = 0.05, 0.2
_KELVINS = np.geomspace(2500, 10000, 50).round().astype(int)


def normalised(neutral: DoubleArray) -> tuple[float, ...]:
    """The neutral scaled so that its largest channel is 1: the brightest white that no channel
    clips.
    """
    return tuple((neutral / neutral.max()).tolist())


def shades_of_grey(colours: FloatArray, full_scale: float = 1.0) -> tuple[float, ...] | None:
    """Estimate what white reads from linear colours by the shades-of-grey method; None if too few
    are well exposed.

    The sixth power favours bright surfaces, which show the light's colour best. On four photographs
    of known neutral the error is 2 to 6 degrees; for the plain mean (grey world) it is 4 to 8.

    Parameters
    ----------
    colours : FloatArray
        (..., C), scene units.
    full_scale : float, optional
        Reading at which a channel clips, scene units.
    """
    colours = colours.reshape(-1, colours.shape[-1])
    # Planes are many times faster to compare than channels that lie side by side.
    planes = np.ascontiguousarray(colours.T)
    fit = (planes.max(axis=0) < _BRIGHT * full_scale) & (planes.mean(axis=0) > _DARK)
    usable = colours[fit].astype(np.float64, order="C")  # the order in which the mean adds
    if len(usable) < 100:  # well exposed colours that an estimate needs
        return None
    shade = np.mean(usable**_MINKOWSKI, axis=0) ** (1 / _MINKOWSKI)
    return normalised(shade) if shade.min() > 0 else None


def estimate_neutral(mosaic: Mosaic) -> tuple[float, ...] | None:
    """Estimate what white reads in a mosaic, largest channel 1, from its colour blocks; None if it
    is too dark or too bright.

    The same for every number of threads and every way of cutting the work into chunks: it sees the
    whole frame.
    """
    calibration, grid = mosaic.calibration, mosaic.pattern.grid(mosaic.shape)
    tops, lefts = grid.whole_rows, grid.whole_columns
    # More than 65536 blocks make no better estimate, and a camera has no time for them.
    every = max(1, len(tops) * len(lefts) >> 16)
    blocks = _blocks(mosaic, tops[every // 2 :: every], lefts)
    # The sixth power would believe a single hot pixel: the median of three neighbours does not.
    left, middle, right = (blocks[..., start : blocks.shape[2] // 3 * 3 : 3] for start in range(3))
    medians = np.maximum(np.minimum(left, middle), np.minimum(np.maximum(left, middle), right))
    shade = shades_of_grey(np.moveaxis(medians, 0, -1), calibration.full_scale)
    return shade and _plausible(np.array(shade), calibration.camera_to_xyz)


def neutral_at(mosaic: Mosaic, row: int, column: int) -> tuple[float, ...] | None:
    """Return what a grey at this pixel reads, largest channel 1: the mean of the colour blocks in
    the GREY_BOX pixels around it, or of the nearest one; None if it is too dark or clipped.
    """
    grid, chosen = mosaic.pattern.grid(mosaic.shape), []
    places = (row, grid.whole_rows), (column, grid.whole_columns)
    for (place, starts), size in zip(places, grid.block_shape, strict=True):
        apart = np.abs(starts + (size - 1) / 2 - place)
        chosen.append(starts[apart <= max(GREY_BOX // 2, apart.min())])
    blocks = _blocks(mosaic, *chosen)
    clips = not blocks.size or blocks.max() >= _BRIGHT * mosaic.calibration.full_scale
    mean = blocks.mean(axis=(1, 2), dtype=np.float64)
    return None if clips or mean.mean() <= _DARK or mean.min() <= 0 else normalised(mean)


def _blocks(mosaic: Mosaic, tops: IndexArray, lefts: IndexArray) -> FloatArray:
    """Return the colours of the blocks that begin at these evenly spaced rows and columns, (C, H,
    W), scene units.
    """
    pattern, calibration = mosaic.pattern, mosaic.calibration
    places, derived = list(pattern.sites), pattern.derived
    if derived is not None:  # Eq. 7 needs luminance, too
        filters = pattern.filter_map(pattern.block_shape, pattern.block_origin)
        clear = np.argwhere(filters == len(pattern.channels)).tolist() or [[0, -1]]
        places += [(row, column, len(pattern.channels)) for row, column in clear]
        lefts = lefts[lefts > 0] if clear[0][1] < 0 else lefts
    if not (len(tops) and len(lefts)):
        return np.zeros((len(pattern.channels), 0, 0), np.float32)
    every = (tops[1] - tops[0]) if len(tops) > 1 else pattern.period
    planes = len(pattern.channels) + (derived is not None)
    blocks = np.zeros((planes, len(tops), len(lefts)), np.float32)
    for row, column, plane in places:
        rows = slice(tops[0] + row, tops[-1] + row + 1, every)
        columns = slice(lefts[0] + column, lefts[-1] + column + 1, pattern.period)
        blocks[plane] += mosaic.samples[rows, columns]
    number = np.bincount([plane for *_, plane in places], minlength=planes)
    blocks /= np.maximum(number, 1)[:, None, None]
    if mosaic.samples.dtype == np.uint16:
        blocks -= np.array(calibration.black_level[:planes], np.float32)[:, None, None]
        blocks *= calibration.scale()[:planes].astype(np.float32)[:, None, None]
        if calibration.shading is not None:
            rows = slice(tops[0], tops[-1] + 1, every)
            columns = slice(lefts[0], lefts[-1] + 1, pattern.period)
            for plane in range(planes):
                blocks[plane] *= calibration.shading.of_plane(mosaic.shape, plane, rows, columns)
    if derived is not None:
        luminance, blocks = blocks[-1], blocks[:-1]
        gamma, colours = np.array(calibration.gamma, np.float32), np.moveaxis(blocks, 0, -1)
        blocks[derived] = derived_channel(luminance, colours, gamma, derived).clip(0)
    return blocks


def _plausible(shade: DoubleArray, camera_to_xyz: Matrix | None) -> tuple[float, ...]:
    """Return a neutral that is near to what the camera reads under light of 2500 to 10000 kelvin: a
    face or wood that fills the picture has a colour of its own.
    """
    if camera_to_xyz is None:
        return normalised(shade)
    illuminants = np.stack([xyz(*illuminant_xy(str(kelvin))) for kelvin in _KELVINS], axis=1)
    readings = (np.linalg.pinv(np.array(camera_to_xyz)) @ illuminants).clip(1e-6)
    apart = np.log(readings / shade[:, None])
    apart -= apart.mean(axis=0)
    distances = np.sqrt((apart**2).sum(axis=0))
    nearest = distances.argmin()
    distance, seen = distances[nearest], np.array(camera_to_xyz) @ shade
    is_greener = seen[1] / seen.sum() > illuminants[1, nearest] / illuminants[:, nearest].sum()
    if distance <= _NEAR or (is_greener and distance > _FAR):
        return normalised(shade)
    return normalised(shade * np.exp(apart[:, nearest] * (1 - _NEAR / distance)))


def clipped_share(readings: Real, clipping: float | Real, shoulder: float) -> Real:
    """Return the degree to which each reading is clipped: 0 up to (1 - shoulder) * clipping, 1 from
    the limit `clipping` on.
    """
    return np.clip((readings - (1 - shoulder) * clipping) / (shoulder * clipping), 0, 1)


def raised_to_white(readings: Real, gone: Real, clipping: float | Real, neutral: ArrayLike) -> Real:
    """Raise clipped readings to what a white surface would read, given the other channels; nothing
    is lowered.

    A white surface clips in one channel after the other. Where all are clipped it is as bright as
    the last of them still allows.

    Parameters
    ----------
    readings : Real
        (..., C), scene units.
    gone : Real
        (..., C), how far each reading counts as clipped, 0 to 1.
    clipping : float | Real
        The limit of the readings, or of each.
    neutral : ArrayLike
        (C,), what white reads in each channel, up to scale.
    """
    white = np.array(neutral, readings.dtype)
    all_gone = gone.prod(axis=-1, keepdims=True)
    level = ((1 - gone) * readings / white).sum(axis=-1, keepdims=True)
    level += np.max(all_gone * clipping / white, axis=-1, keepdims=True)
    level /= (1 - gone).sum(axis=-1, keepdims=True) + all_gone
    return readings + gone * np.maximum(white * level - readings, 0)


def balanced(
    calibration: SensorCalibration, neutral: DoubleArray, *, estimated: bool = False
) -> SensorCalibration:
    """The calibration for a light under which white reads `neutral`, up to scale.

    Each channel is scaled (von Kries), which also works for light that is far from the one of the
    matrix; a calibration for two lights has a matrix for each neutral.

    Parameters
    ----------
    neutral : DoubleArray
        Positive readings, one per channel.
    estimated : bool, optional
        The neutral is an estimate, see `SensorCalibration.neutral_estimated`.

    Raises
    ------
    InputError
        When the calibration has a matrix for which no reading is white.
    """
    white, matrix = normalised(neutral), calibration.camera_to_xyz
    if matrix is not None and calibration.lights is None:
        before = white_reading(matrix, calibration.neutral)
        if before.min() <= 0:
            reason = "camera_to_xyz maps no possible reading to white; calibrate again"
            raise InputError(f"calibration: {reason}")
        matrix = as_rows(np.array(matrix) * (np.array(normalised(before)) / white))
    return replace(calibration, neutral=white, neutral_estimated=estimated, camera_to_xyz=matrix)
