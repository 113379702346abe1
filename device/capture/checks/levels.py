"""Evidence in the levels of samples: their number of bits, the black level, light, and padding at the end of rows.

codes: samples of a frame, (H, W). calibration: the declared levels.
"""

import numpy as np

from shared import SensorCalibration
from shared.arrays import BoolArray, CodeArray

from .tiles import Tiles

_MARGIN = 1 / 16  # of the black level: a black level that is known less well than this is wrong
_LEAST_MARGIN = 1 / 1024  # of the range of codes: a low black level may be off by as much
_NARROW = 1 / 16  # of the range of codes: the samples of a dark frame differ by less, but for defects
_DEFECTS = 1  # percent of the samples at either end that may be defects
_DEEP = 3 / 4  # of the black level: no tile of a frame is darker, on average
_PILE = 8  # samples at the highest code that show that light was clipped there
_LEAST = 10  # bits of the samples of any sensor but those of 8 bits
_WORD = 16  # bits of a word, into whose upper bits some drivers shift samples
_HIGH = 2.0  # times the black level: the darkest samples of a frame are rarely brighter
_UNUSED = 2  # bits
_OVEREXPOSED = 0.1  # of the samples: so many clipped ones may hide the filters


def columns_of_light(codes: CodeArray, calibration: SensorCalibration) -> int:
    """Return the number of columns before padding: values at the end of rows that are the same in every row.

    Padding is darker than black, or, where no other column is even, neither black nor clipped light.
    """
    black, white = min(calibration.black_level), calibration.white_level
    uneven = codes.max(axis=0) > codes.min(axis=0)
    if not (kept := _end(uneven)):
        return len(uneven)
    ends = codes[0, kept:]
    other = (ends < white) & (abs(ends - black) > 1) & uneven[:kept].all()
    return kept + _end(~((ends < black * _DEEP) | other | (ends > white)))


def impossible_level(codes: CodeArray, tiles: Tiles, calibration: SensorCalibration) -> str:
    """Return what no frame of the sensor is like; "" if nothing. tiles: of the frame."""
    declared, highest, black = calibration.bits, int(codes.max()), float(np.mean(calibration.black_level))
    if highest >> declared:
        return f"a sample is {highest}, more than {declared} bits hold"
    remedy = "(`black=N` states another level, `covered` that the lens is covered)"
    if (mean := float(codes.mean())) < black - _margin(calibration):
        return f"the mean of all samples is {mean:.0f}, darker than black, which is {black:.0f} {remedy}"
    if (darkest := float(tiles.parts.mean(axis=(1, 2)).min())) < black * _DEEP:
        return f"a part of it has a mean of {darkest:.0f}, darker than black, which is {black:.0f} {remedy}"
    bits = max(highest.bit_length(), min(declared, _LEAST))
    bits += bits % 2
    if bits < declared and highest == (1 << bits) - 1:
        clipped, below = (int((codes == code).sum()) for code in (highest, highest - 1))
        if clipped > 4 * below + _PILE:
            return f"its light is clipped at {highest}, the highest code of {bits} bits, not at {calibration.white_level}"
    return ""


def light_in_the_dark(codes: CodeArray, calibration: SensorCalibration) -> str:
    """Return what is wrong with a frame of a covered lens, as `impossible_level` does."""
    if int(codes.max()) >> calibration.bits:
        return f"a sample is {int(codes.max())}, more than {calibration.bits} bits hold"
    if is_even(codes, calibration):
        return ""
    low, high = _range(codes)
    return f"its samples are {low:.0f} to {high:.0f}, and those of a dark frame are nearly equal: there is light on the sensor"


def is_even(codes: CodeArray, calibration: SensorCalibration) -> bool:
    """Return whether all samples but defects are nearly equal, as in the dark."""
    low, high = _range(codes)
    return high - low < _NARROW * (1 << calibration.bits)


def is_dark(codes: CodeArray, calibration: SensorCalibration) -> bool:
    """Return whether all samples are near black, as in no wrong layout of a lit frame."""
    black, margin = float(np.mean(calibration.black_level)), _margin(calibration)
    return abs(float(codes.mean()) - black) < margin and int(codes.max()) < _HIGH * black + margin


def hindrance(codes: CodeArray, calibration: SensorCalibration) -> str:
    """Return what keeps a frame from showing its filters."""
    if is_dark(codes, calibration):
        return "it is dark"
    clipped = float((codes >= calibration.white_level).mean())
    if clipped > _OVEREXPOSED:
        return f"{100 * clipped:.0f} % of its samples are clipped: it is overexposed"
    return "it is even, noisy or too dim"


def open_bits(codes: CodeArray, calibration: SensorCalibration) -> str:
    """Return a remark on what the levels of 16-bit words leave open of their number of bits; "" if nothing."""
    declared, highest, black = calibration.bits, int(codes.max()), float(np.mean(calibration.black_level))
    used = int(np.bitwise_or.reduce(codes, axis=None))
    shift = (used & -used).bit_length() - 1
    if shift >= _UNUSED and highest - int(codes.min()) >= 16 << shift and declared < _WORD:
        shifted = f"its samples never use the lowest {shift} bits: they may be shifted up"
        return f"{shifted}; then `sensor_bits={_WORD}` is right"
    if declared - highest.bit_length() >= _UNUSED:
        dim = f"its samples never use the highest of {declared} bits: the light is dim"
        return f"{dim}, or they have fewer; then give `sensor_bits`"
    if _range(codes)[0] > _HIGH * black + _margin(calibration) and highest < calibration.white_level:
        return f"even its darkest samples are far above black, {black:.0f}: is `sensor_bits={declared}` right?"
    return ""


def _range(codes: CodeArray) -> tuple[float, float]:
    """Lowest and highest sample that is no defect."""
    low, high = np.percentile(codes[::7, ::5], (_DEFECTS, 100 - _DEFECTS)).tolist()
    return low, high


def _end(flags: BoolArray) -> int:
    """Number of elements up to the last True; 0 if there is none."""
    return len(flags) - int(flags[::-1].argmax()) if flags.any() else 0


def _margin(calibration: SensorCalibration) -> float:
    """Codes by which the mean of a frame may be darker than black."""
    return max(_MARGIN * float(np.mean(calibration.black_level)), _LEAST_MARGIN * (1 << calibration.bits))
