"""Headers of untrusted JPEGs (ITU T.81, annex B), read before a library decodes them.

A decoder allocates and fills whatever size a JPEG declares, goes through all of its pixels once for
each scan, and reads segments and filling bytes one at a time.
"""

import re
import struct
from dataclasses import dataclass

from .errors import InputError
from .limits import LIMITS, check_count

LOSSLESS = 0xC3
# Without Huffman tables, extensions, arithmetic conditioning.
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_SCAN, _END = 0xDA, 0xD9
# Not a stuffed zero, a filling byte, or one of the markers without a length: a restart, a start,
# TEM.
_MARKER = re.compile(rb"\xff[^\x00\x01\xd0-\xd8\xff]", re.DOTALL)
_LONG_RUN = b"\xff" * (LIMITS["filling bytes"] + 1)


@dataclass(frozen=True)
class JpegHeader:
    """The declarations of a JPEG.

    Attributes
    ----------
    kind : int
        Marker of the frame, 0xC0 to 0xCF.
    bits : int
        Of a sample.
    rows, columns, components : int
        The size.
    scans : int
        How many there are.
    complete : bool
        The end of the picture is marked.
    applications : tuple[bytes, ...]
        What the segments for applications hold, APP0 to APP15, in their order.
    """

    kind: int
    bits: int
    rows: int
    columns: int
    components: int
    scans: int
    complete: bool
    applications: tuple[bytes, ...]

    def held(self, prefix: bytes) -> list[bytes]:
        """Return the contents of the segments that begin with `prefix`, without it."""
        held = (segment for segment in self.applications if segment.startswith(prefix))
        return [segment.removeprefix(prefix) for segment in held]

    @property
    def exif(self) -> bytes:
        """The Exif block from all segments that hold one."""
        return b"".join(self.held(b"Exif\0\0"))

    def check(self, most_pixels: int) -> None:
        """Raise InputError for more pixels or scans than a decoder should be given."""
        if not 0 < self.rows * self.columns <= most_pixels:
            reason = f"{self.columns} x {self.rows}; it is damaged"
            raise InputError(f"a JPEG declares more pixels than it can have, or none: {reason}")
        check_count(self.scans, "scans")
        # only progressive ones have more
        if self.scans > self.components and self.kind not in (0xC2, 0xC6, 0xCA, 0xCE):
            counts = f"a JPEG has {self.scans} scans for {self.components} components"
            raise InputError(f"{counts}: it is damaged or malicious")


def read_header(jpeg: bytes) -> JpegHeader:
    """The header of a JPEG; its markers are found as libjpeg finds them.

    Raises
    ------
    InputError
        When it declares no size, and for more segments or filling than any JPEG has.
    """
    place, frame, applications = 2, None, list[bytes]()
    scans = segments = filling = marker = 0
    while found := _MARKER.search(jpeg, place):
        segments += 1
        filling += 0 if scans else found.start() - place
        check_count(segments, "segments")
        check_count(filling, "filling bytes")
        marker, place = jpeg[found.end() - 1], found.end()
        if marker == _END:
            break
        length = max(2, int.from_bytes(jpeg[place : place + 2], "big"))
        if marker in _FRAMES and frame is None:
            frame = marker, jpeg[place + 2 : place + 8]
        elif 0xE0 <= marker <= 0xEF:  # APP0 to APP15
            applications.append(jpeg[place + 2 : place + length])
        scans += marker == _SCAN
        place += length
    if frame is None or len(frame[1]) < 6:
        raise InputError("a JPEG without a frame: it is cut short or damaged")
    if jpeg.find(_LONG_RUN, 0, place if found else len(jpeg)) >= 0:
        check_count(len(_LONG_RUN), "filling bytes")
    size: tuple[int, int, int, int] = struct.unpack(">BHHB", frame[1])
    # in the order of the fields
    return JpegHeader(frame[0], *size, scans, marker == _END, tuple(applications))
