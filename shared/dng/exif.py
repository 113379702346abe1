"""Convert capture metadata to TIFF, Exif and GPS fields (Exif 2.3, section 4.6), for every format that holds them."""

from ..metadata import CaptureMetadata
from ..tiff import Directory, Fields, FieldType
from .tags import MAKER, GpsTag, Tag

LARGEST_SHORT = 65535
_INCH = 2  # ResolutionUnit
_ISO_SPEED_ALONE = 3  # SensitivityType: the figure is an ISO speed

_GPS_VERSION = bytes([2, 3, 0, 0])
# Field of CaptureMetadata -> tag of its text in the first directory.
TEXTS = {
    "make": Tag.MAKE,
    "model": Tag.MODEL,
    "artist": Tag.ARTIST,
    "copyright": Tag.COPYRIGHT,
    "description": Tag.IMAGE_DESCRIPTION,
}
# Field of CaptureMetadata -> tag of its number in the Exif directory.
NUMBERS = {"exposure_time": Tag.EXPOSURE_TIME, "f_number": Tag.F_NUMBER, "focal_length": Tag.FOCAL_LENGTH}


def metadata_directory(metadata: CaptureMetadata) -> Directory:
    """A directory with the capture metadata, and the Exif and GPS directories below it. The caller adds the fields of the picture.

    Texts are UTF-8 (readers strip blanks around them), numbers are fractions of 31-bit integers. Unknown metadata have no field.
    """
    main = Directory({Tag.ORIENTATION: (FieldType.SHORT, [metadata.orientation]), Tag.SOFTWARE: (FieldType.ASCII, MAKER)})
    exif = Directory({Tag.EXIF_VERSION: (FieldType.UNDEFINED, b"0232")})
    for name, tag in TEXTS.items():
        if text := getattr(metadata, name):
            main.fields[tag] = FieldType.ASCII, text
    if metadata.lens:
        exif.fields[Tag.LENS_MODEL] = FieldType.ASCII, metadata.lens
    for name, tag in NUMBERS.items():
        if (number := getattr(metadata, name)) is not None:
            exif.fields[tag] = FieldType.RATIONAL, [number]
    if metadata.iso is not None:
        exif.fields[Tag.ISO_SPEED_RATINGS] = FieldType.SHORT, [min(metadata.iso, LARGEST_SHORT)]
        if metadata.iso >= LARGEST_SHORT:  # Exif 2.3, Annex G
            exif.fields[Tag.SENSITIVITY_TYPE] = FieldType.SHORT, [_ISO_SPEED_ALONE]
            exif.fields[Tag.ISO_SPEED] = FieldType.LONG, [metadata.iso]
    if metadata.taken is not None:
        # isoformat, because strftime("%Y") does not fill up the year 987 on every system.
        seconds = metadata.taken.replace(tzinfo=None).isoformat(" ", "seconds").replace("-", ":")
        main.fields[Tag.DATE_TIME] = FieldType.ASCII, seconds
        exif.fields[Tag.DATE_TIME_ORIGINAL] = FieldType.ASCII, seconds
        if metadata.taken.microsecond:
            exif.fields[Tag.SUB_SEC_TIME_ORIGINAL] = FieldType.ASCII, f"{metadata.taken.microsecond:06}".rstrip("0")
    if metadata.zone:
        exif.fields[Tag.OFFSET_TIME_ORIGINAL] = FieldType.ASCII, metadata.zone
    main.children[Tag.EXIF_IFD] = exif
    if gps := _gps_fields(metadata):
        main.children[Tag.GPS_IFD] = Directory({GpsTag.VERSION: (FieldType.BYTE, _GPS_VERSION), **gps})
    return main


def _gps_fields(metadata: CaptureMetadata) -> Fields:
    """Return the fields of place and altitude, as far as they are known."""
    fields: Fields = {}
    for tag, letters, angle in zip((GpsTag.LATITUDE, GpsTag.LONGITUDE), ("NS", "EW"), metadata.place or (), strict=False):
        minutes, seconds = divmod(abs(angle) * 3600, 60)
        degrees, minutes = divmod(minutes, 60)
        fields[tag - 1] = FieldType.ASCII, letters[angle < 0]
        fields[tag] = FieldType.RATIONAL, [degrees, minutes, round(seconds, 5)]  # to a millimetre
    if metadata.altitude is not None:
        fields[GpsTag.ALTITUDE_REF] = FieldType.BYTE, bytes([metadata.altitude < 0])
        fields[GpsTag.ALTITUDE] = FieldType.RATIONAL, [abs(metadata.altitude)]
    return fields


def resolution_fields() -> Fields:
    """Fields of the resolution, which TIFF and Exif require: 72 pixels per inch, as Exif prescribes if it is unknown."""
    return {
        Tag.X_RESOLUTION: (FieldType.RATIONAL, [72]),
        Tag.Y_RESOLUTION: (FieldType.RATIONAL, [72]),
        Tag.RESOLUTION_UNIT: (FieldType.SHORT, [_INCH]),
    }
