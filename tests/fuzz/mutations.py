"""Damage that disks, cables, editors and attackers do to files. The same seed does the same
damage.
"""

import re
import struct
from collections.abc import Sequence

import numpy as np

Random = np.random.Generator

_SIZES = (
    *(0, 1, 2, 7, 255, 256, 32767, 65500, 65535, 65536, 1 << 24),
    *((1 << 31) - 1, 1 << 31, (1 << 32) - 1, (1 << 63) - 1),
)
_NUMBERS = (
    *b"0 -1 1e999 NaN".split(),
    *(b"9" * digits for digits in (30, 401, 6000)),
    *b'true 1e-320 1e308 1e30 -1e308 null [] "7" 65536 \xc2\xb2'.split(),
)
_EDGE = 1500  # bytes at either end, where directories and headers are


def mutated(data: bytes, random: Random, others: Sequence[bytes]) -> bytes:
    """The file after one to four mutations. others: files of the same kind, for splices."""
    changed = bytearray(data)
    for _ in range(1 if random.integers(2) else int(random.integers(2, 5))):
        if changed:
            changed = _MUTATIONS[int(random.integers(len(_MUTATIONS)))](changed, random, others)
    return bytes(changed)


def _place(data: bytearray, random: Random) -> int:
    """A random offset; in two of three cases near one end."""
    where, last = int(random.integers(3)), len(data)
    low, high = ((0, last), (0, min(last, _EDGE)), (max(0, last - _EDGE), last))[where]
    return int(random.integers(low, high))


def _flip(data: bytearray, random: Random, _: Sequence[bytes]) -> bytearray:
    for _each in range(int(random.integers(1, 9))):
        data[_place(data, random)] ^= 1 << int(random.integers(8))
    return data


def _truncate(data: bytearray, random: Random, _: Sequence[bytes]) -> bytearray:
    return data[: _place(data, random)]


def _size_field(data: bytearray, random: Random, _: Sequence[bytes]) -> bytearray:
    letter = "HIQ"[int(random.integers(3))]
    order = "<>"[int(random.integers(2))]
    value = _SIZES[int(random.integers(len(_SIZES)))] & (1 << 8 * struct.calcsize(letter)) - 1
    place = _place(data, random) & ~1
    packed = struct.pack(order + letter, value)[: len(data) - place]
    data[place : place + len(packed)] = packed
    return data


def _number(data: bytearray, random: Random, _: Sequence[bytes]) -> bytearray:
    """Replace a number in a text, or any run of digits in a binary file."""
    found = [match.span() for match in re.finditer(rb"\d[\d.]*", data)]
    if found:
        start, end = found[int(random.integers(len(found)))]
        data[start:end] = _NUMBERS[int(random.integers(len(_NUMBERS)))]
    return data


def _block(data: bytearray, random: Random) -> tuple[int, int]:
    start = _place(data, random)
    return start, min(len(data), start + int(random.integers(1, 300)))


def _duplicate(data: bytearray, random: Random, _: Sequence[bytes]) -> bytearray:
    start, end = _block(data, random)
    return data[:end] + data[start:end] * int(random.integers(1, 40)) + data[end:]


def _remove(data: bytearray, random: Random, _: Sequence[bytes]) -> bytearray:
    start, end = _block(data, random)
    return data[:start] + data[end:]


def _noise(data: bytearray, random: Random, _: Sequence[bytes]) -> bytearray:
    start, end = _block(data, random)
    data[start:end] = random.bytes(end - start) if random.integers(2) else bytes(end - start)
    return data


def _splice(data: bytearray, random: Random, others: Sequence[bytes]) -> bytearray:
    """Join the beginning of one file and the end of another, or copy a piece of another to the same
    place.
    """
    other = others[int(random.integers(len(others)))]
    place = _place(data, random)
    if random.integers(2):
        return data[:place] + bytearray(other[place:])
    piece = other[place : place + int(random.integers(1, 600))]
    data[place : place + len(piece)] = piece
    return data


_MUTATIONS = (
    _flip,
    _flip,
    _truncate,
    _size_field,
    _size_field,
    _number,
    _duplicate,
    _remove,
    _noise,
    _splice,
)
