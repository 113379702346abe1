"""Bits of a frame that contradict the description of its sensor, or that leave it open."""

from dataclasses import replace

import numpy as np

from ...shared import CodeArray, DoubleArray, FloatArray, SensorCalibration
from .frames import FORMATS, FrameLayout, RawFrame, Sensor
from .windows import FEWEST_WINDOWS, Windows

# Samples of which nine in ten vary by so much of the range of codes, but that are less correlated
# with all their neighbours, are misread. Of 120 random scenes of two levels, dots of 2 to 9 pixels,
# all are above; wrong packings are at 0 to 0.6.
_WIDE_SPREAD, _RESEMBLE, _PAIRS = 0.33, 0.15, 200
# So are those that vary by so much and would be more correlated by so much in another format with
# groups as long. Of 1456 frames described rightly, photographs and charts, none gains 0.001.
_SPREAD, _MORE = 0.16, 0.1
# stripes of one width do not hide that these are alike; those in other rows share no misread bits
_NEIGHBOURS = (0, 1), (0, 2), (1, 0), (1, 1), (1, -1), (2, 0)
_OTHER_ROWS = _NEIGHBOURS[2:]
_STRAY = 0.1  # of the groups of packed samples: more with unused bits are no error of transmission


def contradiction(sensor: Sensor, frame: RawFrame, codes: CodeArray, windows: Windows) -> str:
    """Return what contradicts the description of a sensor in the bits of one of its frames; "" if
    nothing does.
    """
    layout = sensor.layout
    if reason := padding(codes, sensor.calibration) or unused_bits(frame, layout):
        return reason
    if has_gap(codes, layout) or is_misread(sensor, frame, windows):
        return f"the bits of its samples are not in the order of {layout.format}"
    return ""


def padding(codes: CodeArray, calibration: SensorCalibration) -> str:
    """Return what shows that lines are padded: columns at their end of one value each, neither
    black nor clipped light.
    """
    uneven = codes.max(axis=0) > codes.min(axis=0)
    width = len(uneven) - int(uneven[::-1].argmax())
    ends, black = codes[0, width:].astype(int), min(calibration.black_level)
    filled = (ends < calibration.white_level) & (abs(ends - black) > 1)
    same = f"its rows have {len(ends)} samples at the end that are the same in all of them"
    return f"{same} (`width={width}`?)" if uneven[:width].all() and filled.any() else ""


def unused_bits(frame: RawFrame, layout: FrameLayout) -> str:
    """Return what is wrong with bits of packed groups that hold no sample: 0 is right, as in
    Mono10Packed; "" if nothing.
    """
    packing = FORMATS[layout.format]
    if packing.words:
        return ""
    used = sum(packing.moves.values()).to_bytes(packing.length, "little")
    lines = np.frombuffer(frame.data, np.uint8).reshape(layout.height, layout.stride)
    lines = lines[:: max(layout.height // 64, 1), : layout.line_bytes]
    stray = lines.reshape(-1, packing.length) & ~np.frombuffer(used, np.uint8)
    message = f"bits that {layout.format} leaves unused hold something"
    return message if stray.any(axis=1).mean() > _STRAY else ""


def has_gap(codes: CodeArray, layout: FrameLayout) -> bool:
    """Return whether the highest bit below the upper 8 is always 0, but not all below it: they are
    read from the wrong byte. Codes that are shifted up have none there.
    """
    lower, levels = layout.bits - 8, 1 << layout.bits
    used = int(np.bitwise_or.reduce(codes, axis=None))
    is_between = (~used & (levels - 1)).bit_length() == lower and used % (1 << lower) > 0
    # one in 35 codes tells; those that vary by four steps of the upper 8 bits or less may be dark
    return is_between and _varied(codes[::7, ::5]) > 4 << lower


def is_misread(sensor: Sensor, frame: RawFrame, windows: Windows) -> bool:
    """Return whether samples vary widely and resemble none of their neighbours, or do so more in
    another format: bits of low value are read as bits of high value.
    """
    layout, packing, side = sensor.layout, FORMATS[sensor.layout.format], windows.codes.shape[1]
    if len(windows.codes) < FEWEST_WINDOWS:
        return False
    spread, ours = _resemblance(windows, sensor, _NEIGHBOURS, 1 << sensor.calibration.bits)
    is_wrong = (spread > _WIDE_SPREAD) & (ours < _RESEMBLE)
    for name, other in FORMATS.items():
        is_alike = (other.pixels, other.length) == (packing.pixels, packing.length)
        if is_alike and (ours < 1 - _MORE).any():
            codes = replace(layout, format=name).unpack(frame.data)
            cut = [codes[row : row + side, left : left + side] for row, left in windows.places]
            read = replace(windows, codes=np.stack(cut).astype(np.float32))
            is_wrong |= ours + _MORE < _resemblance(read, sensor, _OTHER_ROWS)[1]
    return bool(is_wrong.any())


def _resemblance(
    windows: Windows, sensor: Sensor, neighbours: tuple[tuple[int, int], ...], levels: int = 1
) -> DoubleArray:
    """Spread of the panchromatic samples at each place of a packed group, of which each may be
    wrong, and their correlation with those neighbours that they resemble most: (2, places), NaN
    where they hardly vary.

    levels: the range of codes, the unit of the spread.
    """
    clear, pixels = windows.panchromatic(sensor.pattern), FORMATS[sensor.layout.format].pixels
    position = (windows.places[:, 1, None] + np.arange(windows.codes.shape[2])) % pixels
    found = np.full((2, pixels), np.nan)
    for number in range(pixels):
        ours = clear & (position == number)[:, None]
        if not ours.any() or (spread := _varied(windows.codes[ours]) / levels) < _SPREAD:
            continue
        for step in (*neighbours, *np.negative(neighbours)):
            beside, is_clear = (np.roll(plane, step, (1, 2)) for plane in (windows.codes, clear))
            if (pair := ours & is_clear).sum() >= _PAIRS:
                with np.errstate(invalid="ignore"):  # neighbours that are all the same
                    alike = np.corrcoef(windows.codes[pair], beside[pair])[0, 1]
                found[:, number] = np.fmax(found[:, number], (spread, alike))
    return found


def _varied(codes: CodeArray | FloatArray) -> float:
    """Range of nine in ten codes: a few defects in the dark do not count."""
    return float(np.ptp(np.percentile(codes, (5, 95))))


def open_bits(codes: CodeArray, calibration: SensorCalibration) -> str:
    """Return a remark on bits that samples never use; "" if they use all."""
    used = int(np.bitwise_or.reduce(codes, axis=None))
    missing = ~used & ((1 << max(used.bit_length(), calibration.bits - 1)) - 1)
    if not missing:
        return ""
    bits = ", ".join(str(bit) for bit in range(missing.bit_length()) if missing >> bit & 1)
    reasons = "the light is dim, they are packed otherwise, or `sensor_bits` is not right"
    return f"bits {bits} of its samples are always 0: {reasons}; the next frames are looked at"
