"""JPEG with full-resolution colour, capture data and colour profile; and Ultra HDR, which is one.

Ultra HDR (Google's Ultra HDR Image Format 1.1) is an ordinary JPEG, followed by a second one that
holds a map of gains.

Programs that know nothing of it show the first JPEG. Others find the second one by the directory of
XMP, or that of a Multi-Picture file, and what its codes mean in XMP (Adobe's gain map 1.0) or in
the metadata of ISO 21496-1; both are written.

A picture ends at display white: the brightest that every channel can measure. The render knows
more: a colour sample saturates later than the panchromatic ones, later still in a channel in which
white reads less, and `offline/stages/highlights.py` rebuilds light up to the channel that clips
last. An HDR display shows it up to there, `headroom` times display white. Where nothing is clipped
the gain is 1, and the picture is the same on every display. So it is where a picture is darkened
and what is burnt out is white.

The gain is that of luminance, the same for all channels. Beyond display white some channel may be
clipped, in the sensor or in the picture that was simulated, and the colour is unknown
(`shared.display`): the colour of a highlight stays that of the picture, or a burnt-out lamp that
the picture shows white would be magenta in HDR.
"""

import struct
from dataclasses import dataclass, replace
from math import log2
from typing import Any, BinaryIO, ClassVar

import imagecodecs
import numpy as np
from numpy.typing import NDArray

from ....shared import CaptureMetadata, InputError
from ....shared.arrays import ByteArray, FloatArray, strips
from ....shared.dng.tags import LONGEST_SIDE, TAG
from ....shared.tiff import Directory, FieldType, encode_tiff
from ..development import Bands, Development, Format, picture_directory
from ..display import ColourTransform, joined

_JFIF_ENDS = 20  # bytes of a JPEG's signature and its first segment
_LONGEST_EXIF = 65533 - len(b"Exif\0\0")  # what fits a segment
_QUALITY = 95  # if none is asked for


class Jpeg(Format):
    """JPEG. The picture is held in 8 bits."""

    name = "jpg"
    aliases: ClassVar[tuple[str, ...]] = ("jpeg",)
    spaces: ClassVar = {"srgb": (8,), "display-p3": (8,)}
    has_quality = True
    in_bands = True
    longest_side = LONGEST_SIDE
    memory_per_pixel = 6.0  # of noise; pictures take three quarters of that

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        codes = joined(bands, development.written_shape[0])
        segments = jpeg_segments(development.directory, codes.shape, development.icc)
        file.write(baseline_jpeg(codes, development.kind.quality, segments))


def encode_jpeg(codes: NDArray[Any], metadata: CaptureMetadata, quality: int | None) -> bytes:
    """Return a JPEG of uint8 RGB (H, W, 3), sRGB, without a profile.

    Raises InputError for another quality, and if a side exceeds 65500 pixels, or the capture data
    64 KiB.

    Parameters
    ----------
    metadata : CaptureMetadata
        Capture data; its orientation is noted, the picture is not turned.
    quality : int | None
        1 to 100; None = 95.
    """
    segments = jpeg_segments(picture_directory(metadata, srgb=True), codes.shape)
    return baseline_jpeg(codes, quality, segments)


def baseline_jpeg(codes: NDArray[Any], quality: int | None, segments: bytes) -> bytes:
    """Return a JPEG of uint8 RGB (H, W, 3) or grey (H, W) in full resolution.

    segments: inserted behind JFIF's, which is first.
    """
    codes = np.ascontiguousarray(codes)
    data = bytes(imagecodecs.jpeg8_encode(codes, level=check_quality(quality), subsampling="444"))
    return data[:_JFIF_ENDS] + segments + data[_JFIF_ENDS:]


def check_quality(quality: int | None) -> int:
    """Return the quality of a JPEG, None for the usual one, as a number.

    Raises InputError unless it is 1 to 100.
    """
    if quality is None:
        return _QUALITY
    if not 1 <= quality <= 100:
        raise InputError(f"the quality is {quality}, expected 1 to 100")
    return quality


def jpeg_segments(directory: Directory, shape: tuple[int, ...], icc: bytes = b"") -> bytes:
    """The segments of a JPEG of (rows, columns, ...) with capture data and profile; for errors see
    `encode_jpeg`.

    directory: capture data; gets the fields that Exif requires in a JPEG.
    """
    height, width = shape[:2]
    directory.fields[TAG["YCbCrPositioning"]] = FieldType.SHORT, [1]
    directory.children[TAG["ExifTag"]].fields |= {
        TAG["ComponentsConfiguration"]: (FieldType.UNDEFINED, b"\1\2\3\0"),  # Y, Cb, Cr
        TAG["PixelXDimension"]: (FieldType.LONG, [width]),
        TAG["PixelYDimension"]: (FieldType.LONG, [height]),
    }
    exif = encode_tiff(directory)
    if max(height, width) > LONGEST_SIDE:
        most = f"a side of a JPEG holds at most {LONGEST_SIDE}"
        raise InputError(f"{width} x {height} pixels: {most}; use png or tif")
    if len(exif) > _LONGEST_EXIF:
        most = f"a JPEG holds at most {_LONGEST_EXIF}"
        raise InputError(f"the capture data fill {len(exif)} bytes, {most}; use png or tif")
    profile = segment(0xE2, b"ICC_PROFILE\0\1\1" + icc) if icc else b""
    return segment(0xE1, b"Exif\0\0" + exif) + profile


def segment(marker: int, data: bytes) -> bytes:
    """A segment of a JPEG, of at most 65533 bytes."""
    return struct.pack(">BBH", 0xFF, marker, len(data) + 2) + data


OFFSET = 1 / 64
"""Offset added to both pictures before their ratio is taken, so that the gain of black stays
finite.
"""

_TOP = 255  # the highest code: of a gain, where that of 1 is 0, and of the picture
_LEAST_RANGE = 1  # stops: less range than this is no HDR
_GAIN_QUALITY = 95  # of the map, which is even nearly everywhere, and so small
_XMP, _ISO, _MPF = b"http://ns.adobe.com/xap/1.0/\0", b"urn:iso:std:iso:ts:21496:-1\0", b"MPF\0"
_APP1, _APP2 = 0xE1, 0xE2
_SAME_PRIMARIES, _UNIT = 0x40, 10**6  # ISO's metadata: a flag, and the denominator of all fractions
_PRIMARY = 0x30000  # the type of the first picture in a Multi-Picture file: baseline primary image

_PACKET = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description rdf:about="" xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" '
    'hdrgm:Version="1.0"{}</rdf:Description></rdf:RDF></x:xmpmeta>'
)
_DIRECTORY = (
    ' xmlns:Container="http://ns.google.com/photos/1.0/container/" xmlns:Item="http://ns.google.com/photos/1.0/container/item/">'
    '<Container:Directory><rdf:Seq><rdf:li rdf:parseType="Resource"><Container:Item '
    'Item:Semantic="Primary" Item:Mime="image/jpeg"/></rdf:li><rdf:li rdf:parseType="Resource">'
    '<Container:Item Item:Semantic="GainMap" Item:Mime="image/jpeg" Item:Length="{}"/></rdf:li>'
    "</rdf:Seq></Container:Directory>"
)


@dataclass(frozen=True)
class GainMap:
    """Coding of the gains of one sensor's pictures, which is the same for all pictures of a kind.

    shown: the transform of the picture that the gains belong to. exposure: gain of the picture,
    stops.
    """

    shown: ColourTransform
    exposure: float = 0.0

    @property
    def headroom(self) -> float:
        """The brightest light that is shown, in units of display white."""
        return max(self.shown.brightest, float(2**_LEAST_RANGE))

    @property
    def highest(self) -> float:
        """The highest gain, stops: from the white of the picture to the brightest light."""
        return max(log2(self.headroom) + self.exposure, float(_LEAST_RANGE))

    def capacity(self, brightest: int) -> float:
        """Headroom in stops that a display needs above white to show all of a picture with this
        highest code.

        Less bright displays show less of every gain: range that a picture does not use would dim
        its highlights there.
        """
        return max(brightest / _TOP * self.highest, _LEAST_RANGE)

    def codes(self, rgb: FloatArray, picture: ByteArray) -> ByteArray:
        """The gains of a rendering in scene units, (H, W, C), of which `picture` has the codes (H,
        W, 3): uint8 (H, W).
        """
        linear = replace(self.shown, space=replace(self.shown.space, linear=True))
        white = np.array(self.shown.white, np.float32)
        result = np.zeros(rgb.shape[:2], np.uint8)
        for rows in strips(len(rgb)):
            band = rgb[rows]
            # channel by channel: NumPy's `any` is slow along a short axis
            beyond = [band[..., channel] > limit for channel, limit in enumerate(white)]
            beyond += [picture[rows, :, channel] == _TOP for channel in range(3)]
            clipped = np.logical_or.reduce(beyond)
            if not clipped.any():
                continue
            bright, most = band[clipped][None], white * np.float32(self.headroom)
            shown = np.empty((*bright.shape[:2], 3), np.float32)
            for _, channel, plane in self.shown.planes(bright, self.exposure, encoded=False):
                shown[..., channel] = plane
            unclipped = linear.apply(bright.clip(-white, most), self.exposure)
            sdr, hdr = self._luminance(shown[0].clip(0, 1)), self._luminance(unclipped[0].clip(0))
            gains = np.log2((hdr + np.float32(OFFSET)) / (sdr + np.float32(OFFSET)))
            result[rows][clipped] = np.rint(gains * np.float32(_TOP / self.highest)).clip(0, _TOP)
        return result

    def _luminance(self, rgb: FloatArray) -> FloatArray:
        red, green, blue = self.shown.space.to_xyz[1].astype(np.float32)
        # No product of matrices: its last bits depend on the shape.
        return np.asarray(rgb[:, 0] * red + rgb[:, 1] * green + rgb[:, 2] * blue)


class UltraHdr(Jpeg):
    """Ultra HDR, whose first picture is that of `Jpeg` with some more segments. Its samples are
    four: RGB, and the gain.
    """

    name, ending, aliases = "uhdr", "jpg", ()
    about = "Ultra HDR, a JPEG with a map of gains for HDR displays"
    memory_per_pixel = 2 * Jpeg.memory_per_pixel

    def samples(self, rgb: FloatArray, development: Development) -> NDArray[Any]:
        """Implement `Format`."""
        codes = super().samples(rgb, development)
        gains = GainMap(development.shown, development.exposure)
        return np.dstack([codes, gains.codes(rgb, codes)])

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        gains = GainMap(development.shown, development.exposure)
        # Copies, even of one pixel: the codec looks at the strides.
        samples = joined(bands, development.written_shape[0])
        segments = jpeg_segments(development.directory, samples.shape, development.icc)
        capacity = gains.capacity(int(samples[..., 3].max()))
        described = _described(*_figures(gains, capacity))
        gain_map = baseline_jpeg(samples[..., 3].copy(), _GAIN_QUALITY, described)
        base = baseline_jpeg(samples[..., :3].copy(), development.kind.quality, segments)
        packet = _PACKET.format(_DIRECTORY.format(len(gain_map)))
        inserted, place = _described(packet.encode(), bytes(4)), _JFIF_ENDS + len(segments)
        sizes = _multi_picture((len(base) + len(inserted), len(gain_map)), place + len(inserted))
        file.write(b"".join((base[:place], inserted, sizes, base[place:], gain_map)))


def _described(xmp: bytes, iso: bytes) -> bytes:
    """The segments of a picture with metadata in XMP and by ISO 21496-1."""
    return segment(_APP1, _XMP + xmp) + segment(_APP2, _ISO + iso)


def _figures(gains: GainMap, capacity: float) -> tuple[bytes, bytes]:
    """The metadata of a gain map in XMP, and by ISO 21496-1, annex C, which has the capacities
    first; gains and capacities are logarithms to the base 2.
    """
    figures = {"HDRCapacityMin": 0.0, "HDRCapacityMax": capacity, "GainMapMin": 0.0}
    figures |= {"GainMapMax": gains.highest, "Gamma": 1.0, "OffsetSDR": OFFSET, "OffsetHDR": OFFSET}
    attributes = "".join(f' hdrgm:{name}="{value:.6f}"' for name, value in figures.items())
    xmp = _PACKET.format(f'{attributes} hdrgm:BaseRenditionIsHDR="False">').encode()
    codes = [struct.pack(">iI", round(value * _UNIT), _UNIT) for value in figures.values()]
    iso = struct.pack(">HHB", 0, 0, _SAME_PRIMARIES) + b"".join(codes)
    return xmp, iso


def _multi_picture(sizes: tuple[int, int], place: int) -> bytes:
    """The segment that says where both pictures are (CIPA DC-007, in the order of bytes that all
    known files have).

    sizes: in bytes, of the first picture without this segment, and of the second. place: of this
    segment in the file.
    """
    # counted, as the second picture's place, from the header behind the name
    table = 8 + 2 + 3 * 12 + 4
    values = 0xB000, 7, 4, b"0100", 0xB001, 4, 1, 2, 0xB002, 7, 2 * 16, table, 0
    fields = struct.pack(">HHI4s HHII HHIII", *values)
    length = 2 + 2 + len(_MPF) + table + 2 * 16
    first, second = sizes[0] + length, sizes[0] + length - place - 2 - 2 - len(_MPF)
    entries = struct.pack(">III4x III4x", _PRIMARY, first, 0, 0, sizes[1], second)
    return segment(_APP2, _MPF + struct.pack(">4sIH", b"MM\0*", 8, 3) + fields + entries)
