"""Formats packed sample by sample, as V4L2, PFNC and GigE Vision have them: slow, and nothing in
common with the product.
"""

import numpy as np
from numpy.typing import NDArray

from panchroma.shared.arrays import CodeArray

GROUPS = {
    "raw10": (10, 4),
    "raw12": (12, 2),
    "raw14": (14, 4),
    "mono10p": (10, 4),
    "mono12p": (12, 2),
    "mono14p": (14, 4),
    "mono10packed": (10, 2),
    "mono12packed": (12, 2),
    "u8": (8, 1),
    "u16": (16, 1),
    "u16be": (16, 1),
}
"""Format -> bits of a sample, samples of a group."""


def pack(codes: CodeArray, layout: str, stride: int = 0, padding: int = 0xA5) -> bytes:
    """Lines of `stride` bytes; what is left of each is filled with `padding`, what is left of its
    last group with zeros. "u8" has the upper bits of samples of 12 bits, if any is so large.
    """
    bits, count = GROUPS[layout]
    if layout == "u8" and codes.max() > 255:
        codes = codes >> np.uint16(4)
    lines = []
    for row in np.pad(codes, ((0, 0), (0, -codes.shape[1] % count))).tolist():
        groups = [row[start : start + count] for start in range(0, len(row), count)]
        line = b"".join(_group(group, layout, bits) for group in groups)
        lines.append(line + bytes([padding]) * max(stride - len(line), 0))
    return b"".join(lines)


def random_codes(shape: tuple[int, int], bits: int, seed: int = 0) -> NDArray[np.uint16]:
    """Codes over the whole range."""
    return np.random.default_rng(seed).integers(0, 1 << bits, shape).astype(np.uint16)


def _group(group: list[int], layout: str, bits: int) -> bytes:
    """CSI-2 has the upper 8 bits of each sample, then the lower ones of all; GigE Vision 'Packed'
    has the lower bits of two samples between the upper ones; PFNC 'p' has no gaps.
    """
    if layout == "u16be":
        return group[0].to_bytes(2, "big")
    if layout in ("u8", "u16") or layout.endswith("p"):
        return _joined(group, bits)
    upper, lower = [code >> bits - 8 for code in group], [code % 2 ** (bits - 8) for code in group]
    if layout.endswith("packed"):
        return bytes([upper[0], lower[0] + 16 * lower[1], upper[1]])
    return bytes(upper) + _joined(lower, bits - 8)


def _joined(values: list[int], bits: int) -> bytes:
    """The first value's lowest bit is the lowest of the first byte, and so on without gaps."""
    whole = sum(value << bits * place for place, value in enumerate(values))
    return whole.to_bytes(bits * len(values) // 8, "little")
