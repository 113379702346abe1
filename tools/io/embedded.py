"""Metadata in picture files: capture data as TIFF and Exif directories."""

from ...shared import CaptureMetadata
from ...shared.dng import metadata_directory
from ...shared.dng.tags import MAKER, TAG
from ...shared.tiff import Directory, FieldType
from .versions import package_version

_SRGB, _UNCALIBRATED = 1, 65535  # values of ColorSpace


def picture_directory(metadata: CaptureMetadata, *, srgb: bool) -> Directory:
    """Return the TIFF directory, with its Exif directory, of a picture in sRGB or in another
    space.
    """
    directory = metadata_directory(metadata)
    directory.fields[TAG["Software"]] = FieldType.ASCII, software()
    directory.children[TAG["ExifTag"]].fields |= {
        TAG["ColorSpace"]: (FieldType.SHORT, [_SRGB if srgb else _UNCALIBRATED]),
        TAG["FlashpixVersion"]: (FieldType.UNDEFINED, b"0100"),
    }
    return directory


def jpeg_directory(metadata: CaptureMetadata, shape: tuple[int, ...], *, srgb: bool) -> Directory:
    """Return `picture_directory` with the fields that Exif requires in a JPEG.

    shape: (rows, columns, ...) of the picture.
    """
    directory = picture_directory(metadata, srgb=srgb)
    directory.fields[TAG["YCbCrPositioning"]] = FieldType.SHORT, [1]
    directory.children[TAG["ExifTag"]].fields |= {
        TAG["ComponentsConfiguration"]: (FieldType.UNDEFINED, b"\1\2\3\0"),  # Y, Cb, Cr
        TAG["PixelXDimension"]: (FieldType.LONG, [shape[1]]),
        TAG["PixelYDimension"]: (FieldType.LONG, [shape[0]]),
    }
    return directory


def software() -> str:
    """Return name and version of the program; a checkout that is not installed has no version."""
    return " ".join(filter(None, (MAKER, package_version("panchroma"))))
