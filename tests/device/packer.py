"""Formats packed bit by bit, as V4L2, PFNC and GigE Vision have them: slow, and nothing in common
with the product.
"""

import numpy as np
from numpy.typing import NDArray

from panchroma.shared.arrays import CodeArray

GROUPS = {"raw10": (10, 4), "raw12": (12, 2), "raw14": (14, 4)}
STREAMS = {"mono10p": (10, 4), "mono12p": (12, 2), "mono14p": (14, 4)}


def pack(codes: CodeArray, layout: str, stride: int = 0, padding: int = 0xA5) -> bytes:
    """Lines of `stride` bytes; what is left of each is filled with `padding`, what is left of its
    last group with zeros.
    """
    lines = []
    for row in codes.tolist():
        if layout in GROUPS:
            line = _groups(row, *GROUPS[layout])
        elif layout in STREAMS:
            line = _stream(row, *STREAMS[layout])
        elif layout.endswith("packed"):
            line = _packed(row, int(layout[4:6]) - 8)
        else:
            line = _words(row, layout)
        lines.append(line + bytes([padding]) * max(stride - len(line), 0))
    return b"".join(lines)


def random_codes(shape: tuple[int, int], bits: int, seed: int = 0) -> NDArray[np.uint16]:
    """Codes over the whole range."""
    return np.random.default_rng(seed).integers(0, 1 << bits, shape).astype(np.uint16)


def _words(row: list[int], layout: str) -> bytes:
    """Words, of "u16be" the high byte first; of "u8" bytes, the upper bits of samples of 12 bits if
    any is so large.
    """
    if layout == "u8":
        return bytes(code >> (4 if max(row) > 255 else 0) for code in row)
    return b"".join(code.to_bytes(2, "big" if layout == "u16be" else "little") for code in row)


def _stream(row: list[int], bits: int, pixels: int) -> bytes:
    """PFNC 'p': the first pixel's lowest bit is the lowest of the first byte, and so on without
    gaps.
    """
    text = "".join(format(code, f"0{bits}b")[::-1] for code in row + [0] * (-len(row) % pixels))
    return bytes(int(text[start : start + 8][::-1], 2) for start in range(0, len(text), 8))


def _packed(row: list[int], lower: int) -> bytes:
    """GigE Vision 'Packed': two pixels in three bytes."""
    line = []
    for start in range(0, len(row), 2):
        first, second = [*row[start : start + 2], 0][:2]
        line += [first >> lower, first % 2**lower + second % 2**lower * 16, second >> lower]
    return bytes(line)


def _groups(row: list[int], bits: int, pixels: int) -> bytes:
    lower = bits - 8
    line = []
    for start in range(0, len(row), pixels):
        group = (row[start : start + pixels] + [0] * pixels)[:pixels]
        line += [code >> lower for code in group]
        last = sum(code % 2**lower << place * lower for place, code in enumerate(group))
        line += last.to_bytes(lower * pixels // 8, "little")
    return bytes(line)
