"""Ultra HDR JPEGs (Google's Ultra HDR Image Format 1.1): an ordinary JPEG, followed by a second one that holds a map of gains.

Programs that know nothing of it show the first JPEG. Others find the second one by the directory of XMP, or that of a Multi-Picture
file, and what its codes mean in XMP (Adobe's gain map 1.0) or in the metadata of ISO 21496-1; both are written.
"""

import struct
from collections.abc import Iterable
from typing import Any, BinaryIO, ClassVar

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray
from shared.dng.tags import LONGEST_SIDE
from shared.jpeg_writing import ROWS, JpegStrip, encode_strip, join_strips
from tools.host.ahead import ahead

from ..development import Development
from ..gain_map import OFFSET, GainMap
from ..samples import regrouped
from .format import Format
from .jpg import Jpeg, development_segments, jpeg_level, segment

_GAIN_QUALITY = 95  # of the map, which is even nearly everywhere, and so small
_XMP, _ISO, _MPF = b"http://ns.adobe.com/xap/1.0/\0", b"urn:iso:std:iso:ts:21496:-1\0", b"MPF\0"
_APP1, _APP2 = 0xE1, 0xE2
_JFIF_ENDS = 20  # a JPEG's signature and its first segment
_SAME_PRIMARIES, _UNIT = 0x40, 10**6  # ISO's metadata: a flag, and the denominator of all fractions
_PRIMARY = 0x30000  # the type of the first picture in a Multi-Picture file: baseline primary image

_PACKET = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description rdf:about="" xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0"{}</rdf:Description>'
    "</rdf:RDF></x:xmpmeta>"
)
_DIRECTORY = (
    ' xmlns:Container="http://ns.google.com/photos/1.0/container/" xmlns:Item="http://ns.google.com/photos/1.0/container/item/">'
    '<Container:Directory><rdf:Seq><rdf:li rdf:parseType="Resource"><Container:Item Item:Semantic="Primary" '
    'Item:Mime="image/jpeg"/></rdf:li><rdf:li rdf:parseType="Resource"><Container:Item Item:Semantic="GainMap" '
    'Item:Mime="image/jpeg" Item:Length="{}"/></rdf:li></rdf:Seq></Container:Directory>'
)


class UltraHdr(Format):
    """Ultra HDR, whose first picture is that of `Jpeg` with some more segments. Its samples are four: RGB, and the gain."""

    name = "uhdr"
    spaces: ClassVar = Jpeg.spaces
    about = "Ultra HDR, a JPEG with a map of gains for HDR displays"
    has_quality = True
    in_bands = True
    longest_side = LONGEST_SIDE
    memory_per_pixel = 2 * Jpeg.memory_per_pixel

    @property
    def suffix(self) -> str:
        """See `Format`."""
        return ".jpg"

    def samples(self, rgb: FloatArray, development: Development) -> NDArray[Any]:
        """See `Format`."""
        codes = super().samples(rgb, development)
        return np.dstack([codes, _gains(development).codes(rgb, codes)])

    def encode(self, file: BinaryIO, bands: Iterable[NDArray[Any]], development: Development, threads: int) -> None:
        """See `Format`."""
        level, segments, gains = jpeg_level(development.kind.quality), development_segments(development), _gains(development)

        def encoded(rows: NDArray[Any]) -> tuple[JpegStrip, JpegStrip, int]:
            picture, codes = rows[..., :3].copy(), rows[..., 3].copy()  # copies, even of one pixel: the codec looks at the strides
            return encode_strip(picture, level, "444"), encode_strip(codes, _GAIN_QUALITY, "444"), int(codes.max())

        pictures, maps, highest = zip(*ahead(encoded, regrouped(bands, ROWS), threads), strict=True)
        capacity = gains.capacity(max(highest))
        described = segment(_APP1, _XMP + _xmp(gains, capacity)) + segment(_APP2, _ISO + _iso(gains, capacity))
        gain_map, base = join_strips(maps, described), join_strips(pictures, segments)
        packet = _PACKET.format(_DIRECTORY.format(len(gain_map)))
        inserted, place = segment(_APP1, _XMP + packet.encode()) + segment(_APP2, _ISO + bytes(4)), _JFIF_ENDS + len(segments)
        sizes = _multi_picture((len(base) + len(inserted), len(gain_map)), place + len(inserted))
        file.write(b"".join((base[:place], inserted, sizes, base[place:], gain_map)))


def _gains(development: Development) -> GainMap:
    """What the codes of the gains mean."""
    return GainMap(development.shown, development.exposure)


def _xmp(gains: GainMap, capacity: float) -> bytes:
    """The metadata of a gain map in XMP; gains and capacities are logarithms to the base 2."""
    values = {
        "GainMapMin": 0.0,
        "GainMapMax": gains.highest,
        "Gamma": 1.0,
        "OffsetSDR": OFFSET,
        "OffsetHDR": OFFSET,
        "HDRCapacityMin": 0.0,
        "HDRCapacityMax": capacity,
    }
    attributes = "".join(f' hdrgm:{name}="{value:.6f}"' for name, value in values.items())
    return _PACKET.format(f'{attributes} hdrgm:BaseRenditionIsHDR="False">').encode()


def _iso(gains: GainMap, capacity: float) -> bytes:
    """The metadata of a gain map by ISO 21496-1, annex C."""
    values = 0.0, capacity, 0.0, gains.highest, 1.0, OFFSET, OFFSET
    return struct.pack(">HHB", 0, 0, _SAME_PRIMARIES) + b"".join(map(_fraction, values))


def _fraction(value: float) -> bytes:
    return struct.pack(">iI", round(value * _UNIT), _UNIT)


def _multi_picture(sizes: tuple[int, int], place: int) -> bytes:
    """The segment that says where both pictures are (CIPA DC-007, in the order of bytes that all known files have).

    sizes: in bytes, of the first picture without this segment, and of the second. place: of this segment in the file.
    """
    table = 8 + 2 + 3 * 12 + 4  # counted, as the second picture's place, from the header behind the name
    fields = struct.pack(">HHI4s HHII HHIII", 0xB000, 7, 4, b"0100", 0xB001, 4, 1, 2, 0xB002, 7, 2 * 16, table, 0)
    length = 2 + 2 + len(_MPF) + table + 2 * 16
    first, second = sizes[0] + length, sizes[0] + length - place - 2 - 2 - len(_MPF)
    entries = struct.pack(">III4x III4x", _PRIMARY, first, 0, 0, sizes[1], second)
    return segment(_APP2, _MPF + struct.pack(">4sIH", b"MM\0*", 8, 3) + fields + entries)
