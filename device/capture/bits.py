"""Bits of a frame that contradict the description of its sensor, or that leave it open."""

import numpy as np

from ...shared import CfaPattern, CodeArray, SensorCalibration
from .frames import FORMATS, FrameLayout, RawFrame, Sensor
from .windows import FEWEST_WINDOWS, Windows

# Samples that vary by so much of the range of codes, but are less correlated with all their
# neighbours, are misread. Of 120 random scenes of two levels, dots of 2 to 9 pixels, all are above;
# wrong packings are at 0 to 0.6.
_WIDE_SPREAD, _RESEMBLE, _PAIRS = 0.1, 0.15, 200
# stripes of one width do not hide that these are alike
_NEIGHBOURS = (0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0)
_STRAY = 0.1  # of the groups of packed samples: more with unused bits are no error of transmission


def contradiction(sensor: Sensor, frame: RawFrame, codes: CodeArray, windows: Windows) -> str:
    """Return what contradicts the description of a sensor in the bits of one of its frames; "" if
    nothing does.
    """
    layout, calibration = sensor.layout, sensor.calibration
    if reason := padding(codes, calibration) or unused_bits(frame, layout):
        return reason
    pixels = FORMATS[layout.format].pixels
    if is_misread(windows, sensor.pattern, pixels, calibration.bits):
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


def is_misread(windows: Windows, pattern: CfaPattern, pixels: int, bits: int) -> bool:
    """Return whether samples vary widely and resemble none of their neighbours: bits of low value
    are read as bits of high value.

    pixels: samples of a packed group, of which each may be wrong. bits: of a sample.
    """
    if len(windows.codes) < FEWEST_WINDOWS:
        return False
    clear = windows.panchromatic(pattern)
    position = (windows.places[:, 1, None] + np.arange(windows.codes.shape[2])) % pixels
    for number in range(pixels):
        ours = clear & (position == number)[:, None]
        if not ours.any() or np.std(windows.codes, where=ours) < _WIDE_SPREAD * (1 << bits):
            continue
        alike = []
        for step in (*_NEIGHBOURS, *np.negative(_NEIGHBOURS)):
            beside, is_clear = (np.roll(plane, step, (1, 2)) for plane in (windows.codes, clear))
            if (pair := ours & is_clear).sum() >= _PAIRS:
                alike.append(np.corrcoef(windows.codes[pair], beside[pair])[0, 1])
        if alike and max(alike) < _RESEMBLE:
            return True
    return False


def open_bits(codes: CodeArray, calibration: SensorCalibration) -> str:
    """Return a remark on bits that samples never use; "" if they use all."""
    used = int(np.bitwise_or.reduce(codes, axis=None))
    missing = ~used & ((1 << max(used.bit_length(), calibration.bits - 1)) - 1)
    if not missing:
        return ""
    bits = ", ".join(str(bit) for bit in range(missing.bit_length()) if missing >> bit & 1)
    return (
        f"bits {bits} of its samples are always 0: the light is dim, they are packed otherwise, "
        "or `sensor_bits` is not right; the next frames are looked at"
    )
