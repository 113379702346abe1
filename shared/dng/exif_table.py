"""The Exif fields that results carry as their source has them, beside those that `CaptureMetadata` names (Exif 2.32, 4.6.5-6).

What depends on the pixels of the source is not among them: sizes, resolutions, places in the picture, processing.
"""

from dataclasses import dataclass
from typing import Literal

from ..tiff import FieldType
from .tags import Tag

DirectoryName = Literal["main", "exif", "gps"]

GPS_VERSION = 0


@dataclass(frozen=True)
class Kept:
    """A field that is carried along: name in Exif, type, number of values (of a text, with its final NUL); 0 = any number."""

    name: str
    kind: FieldType
    count: int = 0


_A, _B, _S, _R, _SR = FieldType.ASCII, FieldType.BYTE, FieldType.SHORT, FieldType.RATIONAL, FieldType.SRATIONAL

KEPT: dict[tuple[DirectoryName, int], Kept] = {
    ("main", Tag.DATE_TIME): Kept("DateTime", _A, 20),
    ("exif", 34850): Kept("ExposureProgram", _S, 1),
    ("exif", 36868): Kept("DateTimeDigitized", _A, 20),
    ("exif", 36880): Kept("OffsetTime", _A),
    ("exif", 36881): Kept("OffsetTimeOriginal", _A),
    ("exif", 36882): Kept("OffsetTimeDigitized", _A),
    ("exif", 37377): Kept("ShutterSpeedValue", _SR, 1),
    ("exif", 37378): Kept("ApertureValue", _R, 1),
    ("exif", 37379): Kept("BrightnessValue", _SR, 1),
    ("exif", 37380): Kept("ExposureBiasValue", _SR, 1),
    ("exif", 37381): Kept("MaxApertureValue", _R, 1),
    ("exif", 37382): Kept("SubjectDistance", _R, 1),
    ("exif", 37383): Kept("MeteringMode", _S, 1),
    ("exif", 37384): Kept("LightSource", _S, 1),
    ("exif", 37385): Kept("Flash", _S, 1),
    ("exif", Tag.SUB_SEC_TIME): Kept("SubSecTime", _A),
    ("exif", Tag.SUB_SEC_TIME_ORIGINAL): Kept("SubSecTimeOriginal", _A),
    ("exif", 37522): Kept("SubSecTimeDigitized", _A),
    ("exif", 41483): Kept("FlashEnergy", _R, 1),
    ("exif", 41493): Kept("ExposureIndex", _R, 1),
    ("exif", 41986): Kept("ExposureMode", _S, 1),
    ("exif", 41988): Kept("DigitalZoomRatio", _R, 1),
    ("exif", 41989): Kept("FocalLengthIn35mmFilm", _S, 1),
    ("exif", 41990): Kept("SceneCaptureType", _S, 1),
    ("exif", 41991): Kept("GainControl", _S, 1),
    ("exif", 41996): Kept("SubjectDistanceRange", _S, 1),
    ("exif", 42032): Kept("CameraOwnerName", _A),
    ("exif", Tag.LENS_SPECIFICATION): Kept("LensSpecification", _R, 4),
    ("exif", 42035): Kept("LensMake", _A),
    ("exif", 42037): Kept("LensSerialNumber", _A),
    ("gps", GPS_VERSION): Kept("GPSVersionID", _B, 4),
    ("gps", 1): Kept("GPSLatitudeRef", _A, 2),
    ("gps", 2): Kept("GPSLatitude", _R, 3),
    ("gps", 3): Kept("GPSLongitudeRef", _A, 2),
    ("gps", 4): Kept("GPSLongitude", _R, 3),
    ("gps", 5): Kept("GPSAltitudeRef", _B, 1),
    ("gps", 6): Kept("GPSAltitude", _R, 1),
    ("gps", 7): Kept("GPSTimeStamp", _R, 3),
    ("gps", 8): Kept("GPSSatellites", _A),
    ("gps", 9): Kept("GPSStatus", _A, 2),
    ("gps", 10): Kept("GPSMeasureMode", _A, 2),
    ("gps", 11): Kept("GPSDOP", _R, 1),
    ("gps", 12): Kept("GPSSpeedRef", _A, 2),
    ("gps", 13): Kept("GPSSpeed", _R, 1),
    ("gps", 14): Kept("GPSTrackRef", _A, 2),
    ("gps", 15): Kept("GPSTrack", _R, 1),
    ("gps", 16): Kept("GPSImgDirectionRef", _A, 2),
    ("gps", 17): Kept("GPSImgDirection", _R, 1),
    ("gps", 18): Kept("GPSMapDatum", _A),
    ("gps", 19): Kept("GPSDestLatitudeRef", _A, 2),
    ("gps", 20): Kept("GPSDestLatitude", _R, 3),
    ("gps", 21): Kept("GPSDestLongitudeRef", _A, 2),
    ("gps", 22): Kept("GPSDestLongitude", _R, 3),
    ("gps", 23): Kept("GPSDestBearingRef", _A, 2),
    ("gps", 24): Kept("GPSDestBearing", _R, 1),
    ("gps", 25): Kept("GPSDestDistanceRef", _A, 2),
    ("gps", 26): Kept("GPSDestDistance", _R, 1),
    ("gps", 27): Kept("GPSProcessingMethod", FieldType.UNDEFINED),
    ("gps", 28): Kept("GPSAreaInformation", FieldType.UNDEFINED),
    ("gps", 29): Kept("GPSDateStamp", _A, 11),
    ("gps", 30): Kept("GPSDifferential", _S, 1),
    ("gps", 31): Kept("GPSHPositioningError", _R, 1),
}

# A number of the GPS directory means something else without its reference, which says for instance north or south.
REFERENCES: dict[int, tuple[int, str]] = {
    2: (1, "NS"),
    4: (3, "EW"),
    13: (12, "KMN"),
    20: (19, "NS"),
    22: (21, "EW"),
    26: (25, "KMN"),
}
