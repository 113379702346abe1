"""The size that a JPEG XL image declares, read before a library decodes the image.

Source: ISO/IEC 18181-1:2022, annex A.5 (SizeHeader); ISO/IEC 18181-2 (boxes).
"""

from ...shared.errors import InputError

_CONTAINER, _CODESTREAM = b"\0\0\0\x0cJXL \r\n\x87\n", b"\xff\x0a"
_SIDE_BITS = 9, 13, 18, 30  # of a side, by its selector
_RATIOS = (1, 1), (12, 10), (4, 3), (3, 2), (16, 9), (5, 4), (2, 1)  # columns to rows
_HEAD = 16  # bytes: more than a SizeHeader has


def declared_size(image: bytes) -> tuple[int, int]:
    """Return the (rows, columns) that a JPEG XL image declares.

    image: a codestream, or a container with one. Raises InputError for anything else.

    Examples
    --------
    >>> from panchroma.tools.io.jpegxl import declared_size
    >>> declared_size(bytes.fromhex("ff0a4f40240804010058074b28b129a3"))
    (64, 64)
    """
    head = _codestream(image) if image.startswith(_CONTAINER) else image[:_HEAD]
    if not head.startswith(_CODESTREAM) or len(head) < _HEAD:
        raise InputError("holds no JPEG XL image where it should: it is damaged")
    bits = int.from_bytes(head[len(_CODESTREAM) :], "little")

    def take(count: int) -> int:
        nonlocal bits
        value, bits = bits & ((1 << count) - 1), bits >> count
        return value

    def side() -> int:
        return 8 * (take(5) + 1) if in_eights else take(_SIDE_BITS[take(2)]) + 1

    in_eights = bool(take(1))
    rows = side()
    ratio = take(3)
    if not ratio:
        return rows, side()
    numerator, denominator = _RATIOS[ratio - 1]
    return rows, rows * numerator // denominator


def _codestream(container: bytes) -> bytes:
    """Return the beginning of the codestream in the boxes of a container; empty without one."""
    place = 0
    while place + 8 <= len(container):
        length = int.from_bytes(container[place : place + 4], "big")
        kind = container[place + 4 : place + 8]
        begin = place + 8
        if length == 1:  # 64 bits follow
            length, begin = int.from_bytes(container[begin : begin + 8], "big"), begin + 8
        if kind in (b"jxlc", b"jxlp"):  # the latter is a part, after its number
            begin += 4 * (kind == b"jxlp")
            return container[begin : begin + _HEAD]
        if length < begin - place:  # 0: to the end of the file
            break
        place += length
    return b""
