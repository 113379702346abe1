"""Metadata in picture files: capture data as TIFF and Exif directories."""

from ...shared import CaptureMetadata
from ...shared.dng import metadata_directory
from ...shared.dng.exif import resolution_fields
from ...shared.dng.tags import MAKER, TAG
from ...shared.tiff import Directory, FieldType
from .versions import package_version

# Exif 2.3, tables 4 and 15: required fields besides the capture data.
_COLOR_SPACE, _COMPONENTS, _FLASHPIX, _PIXEL_X, _PIXEL_Y = 40961, 37121, 40960, 40962, 40963
_SRGB, _UNCALIBRATED = 1, 65535


def picture_directory(metadata: CaptureMetadata, *, srgb: bool) -> Directory:
    """Return the TIFF directory, with its Exif directory, of a picture in sRGB or in another
    space.
    """
    directory = metadata_directory(metadata)
    directory.fields.update(resolution_fields())
    directory.fields[TAG["Software"]] = FieldType.ASCII, software()
    directory.children[TAG["ExifTag"]].fields |= {
        _COLOR_SPACE: (FieldType.SHORT, [_SRGB if srgb else _UNCALIBRATED]),
        _FLASHPIX: (FieldType.UNDEFINED, b"0100"),
    }
    return directory


def jpeg_directory(metadata: CaptureMetadata, shape: tuple[int, ...], *, srgb: bool) -> Directory:
    """Return `picture_directory` with the fields that Exif requires in a JPEG.

    Parameters
    ----------
    shape : tuple[int, ...]
        (rows, columns, ...) of the picture.
    """
    directory = picture_directory(metadata, srgb=srgb)
    directory.fields[TAG["YCbCrPositioning"]] = FieldType.SHORT, [1]
    directory.children[TAG["ExifTag"]].fields |= {
        _COMPONENTS: (FieldType.UNDEFINED, b"\1\2\3\0"),  # Y, Cb, Cr
        _PIXEL_X: (FieldType.LONG, [shape[1]]),
        _PIXEL_Y: (FieldType.LONG, [shape[0]]),
    }
    return directory


def software() -> str:
    """Return name and version of the program; a checkout that is not installed has no version."""
    return " ".join(filter(None, (MAKER, package_version("panchroma"))))
