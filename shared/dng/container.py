"""The common structure of all our DNG files: first a JPEG preview, below it the lossless samples,
and the digest of the samples.
"""

import hashlib
from html import escape
from itertools import product

import imagecodecs
import numpy as np

from ..arrays import ByteArray, CodeArray
from ..errors import InputError
from ..metadata import CaptureMetadata
from ..tiff import Directory, Fields, FieldType
from .exif import metadata_directory, printable
from .lossless_jpeg import encode_lossless
from .tags import DNG_VERSION, LONGEST_SIDE, MAKER, TAG, Compression, Photometric, fields_of

PREVIEW_QUALITY = 90  # of 100: no visible artefacts, a tenth of the size of the samples
DIGEST_TILE = 256
_SHORT = FieldType.SHORT
_XMP = (
    '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
    '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description '
    'rdf:about="" xmlns:tiff="http://ns.adobe.com/tiff/1.0/">{}</rdf:Description></rdf:RDF>'
    '</x:xmpmeta><?xpacket end="w"?>'
)


def main_directory(
    preview: ByteArray, metadata: CaptureMetadata, camera: str, raw: Directory, digest: bytes
) -> Directory:
    """The first directory of a DNG: preview, metadata, and the raw directory below it.

    Parameters
    ----------
    preview : ByteArray
        (h, w, 3) uint8 sRGB, in the orientation of the samples.
    metadata : CaptureMetadata
        Capture data.
    camera : str
        UniqueCameraModel and Model, a name under which converters look up colour profiles; Make is
        `MAKER`.
    raw : Directory
        Directory of the samples, from `raw_directory`.
    digest : bytes
        Digest of the samples, from `raw_digest`.

    Raises
    ------
    InputError
        For another kind of preview.
    """
    picture = np.ascontiguousarray(preview)
    if picture.dtype != np.uint8 or picture.shape[2:] != (3,) or not picture.size:
        expected = "expected a uint8 picture (rows, columns, 3)"
        raise InputError(f"the preview is {picture.dtype} {picture.shape}, {expected}")
    check_sides(picture.shape)
    main = metadata_directory(metadata)
    # Raw developers take Make and Model for the camera that saw these samples, and give them its
    # colours. No camera but ours did; the source's name is in the XMP, which none of them looks
    # into for that.
    named = camera.encode("ascii", "replace").decode()
    if metadata.make or metadata.model:
        main.fields |= fields_of(FieldType.BYTE, XMP=_xmp(metadata))
    # UniqueCameraModel is the only text that DNG requires to be ASCII; converters look up camera
    # profiles by it.
    main.fields |= fields_of(FieldType.ASCII, Make=MAKER, Model=named, UniqueCameraModel=named)
    # One strip, so that it is a whole JPEG, which exiftool, LibRaw and every picture viewer can
    # extract.
    jpeg = imagecodecs.jpeg8_encode(picture, level=PREVIEW_QUALITY, subsampling="420")
    main.strips = [bytes(jpeg)]
    main.fields |= picture_fields(picture.shape, 8, Compression.JPEG, Photometric.YCBCR)
    main.fields |= fields_of(FieldType.LONG, NewSubfileType=[1], PreviewColorSpace=[2])  # sRGB
    main.fields |= fields_of(_SHORT, YCbCrSubSampling=[2, 2], YCbCrPositioning=[1])  # centred
    main.fields |= fields_of(FieldType.RATIONAL, ReferenceBlackWhite=[0, 255, 128, 255, 128, 255])
    main.fields |= fields_of(FieldType.BYTE, DNGVersion=DNG_VERSION, NewRawImageDigest=digest)
    # a reader of DNG 1.2 can show the file
    main.fields |= fields_of(FieldType.BYTE, DNGBackwardVersion=bytes([1, 2, 0, 0]))
    main.children[TAG["SubIFDs"]] = raw
    return main


def raw_directory(samples: CodeArray, bits: int, photometric: Photometric) -> Directory:
    """The directory of the samples, as one strip of lossless JPEG.

    Parameters
    ----------
    samples : CodeArray
        (H, W) or (H, W, planes).
    bits : int
        Bits of a sample, 10 to 16.
    photometric : Photometric
        interpretation of the samples.

    Raises
    ------
    InputError
        When a side is longer than a JPEG can be.
    """
    check_sides(samples.shape)
    fields = picture_fields(samples.shape, bits, Compression.JPEG, photometric)
    fields |= fields_of(FieldType.LONG, NewSubfileType=[0])
    return Directory(fields, strips=[encode_lossless(samples, bits)])


def raw_digest(samples: CodeArray) -> bytes:
    """NewRawImageDigest (DNG 1.4) of samples (H, W) or (H, W, planes).

    It is the MD5 over the MD5s of the 256 x 256 tiles in row order (cut off at the edges), samples
    little-endian, plane by plane.
    """
    return md5(tile_digests(samples))


def tile_digests(samples: CodeArray) -> bytes:
    """The MD5s that `raw_digest` joins; those of strips of a picture, each `DIGEST_TILE` rows but
    the last, follow each other.
    """
    planes = samples[None] if samples.ndim == 2 else np.moveaxis(samples, -1, 0)
    rows, columns = planes.shape[1:]
    digests = b""
    for top, left in product(range(0, rows, DIGEST_TILE), range(0, columns, DIGEST_TILE)):
        tile = planes[:, top : top + DIGEST_TILE, left : left + DIGEST_TILE]
        digests += md5(tile.astype("<u2", copy=False).tobytes())
    return digests


def md5(data: bytes) -> bytes:
    """The digest of a tile from its samples, and of a picture from the digests of its tiles."""
    return hashlib.md5(data, usedforsecurity=False).digest()


def _xmp(metadata: CaptureMetadata) -> bytes:
    """An XMP packet with make and model of the source (XMP Specification Part 1, 7.3; Part 2, 8.5:
    the namespace tiff).
    """
    named = ("Make", printable(metadata.make)), ("Model", printable(metadata.model))
    fields = (f"<tiff:{name}>{escape(text)}</tiff:{name}>" for name, text in named if text)
    return _XMP.format("".join(fields)).encode("utf-8", "replace")


def picture_id(shape: tuple[int, ...], digest: bytes) -> str:
    """RawDataUniqueID of a rendered picture, 16 hexadecimal digits: it covers the shape, which
    NewRawImageDigest does not.
    """
    return hashlib.sha256(repr(shape).encode() + digest).hexdigest()[:16]


def picture_fields(shape: tuple[int, ...], bits: int, compression: int, photometric: int) -> Fields:
    """The fields of a TIFF picture of samples (H, W) or (H, W, planes) in one strip; `bits` per
    sample.
    """
    (rows, columns), planes = shape[:2], shape[2] if len(shape) == 3 else 1
    sides = fields_of(FieldType.LONG, ImageWidth=[columns], ImageLength=[rows], RowsPerStrip=[rows])
    samples = fields_of(_SHORT, BitsPerSample=[bits] * planes, SamplesPerPixel=[planes])
    kinds = fields_of(_SHORT, Compression=[compression], PhotometricInterpretation=[photometric])
    return sides | samples | kinds | fields_of(_SHORT, PlanarConfiguration=[1])  # interleaved


def check_sides(shape: tuple[int, ...]) -> None:
    """Raise InputError if a side is longer than a JPEG can be."""
    if max(shape[:2]) > LONGEST_SIDE:
        reason = f"a side of a DNG's JPEG holds at most {LONGEST_SIDE}; cut it up"
        raise InputError(f"{shape[1]} x {shape[0]} pixels: {reason}")
