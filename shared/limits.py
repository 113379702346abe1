"""Limits of what untrusted TIFFs and JPEGs may declare: above what files have, and below what keeps
a reader busy.
"""

from .errors import InputError

LIMITS = {
    # TIFF
    "directories": 64,  # a camera RAW has about ten
    "fields in a directory": 1024,  # the largest in use have a hundred
    # of a field: offsets of the 64 x 64 tiles of 268 megapixels, or of strips of one row
    "numbers": 1 << 16,
    "bytes": 16 << 20,  # of a field: a colour profile, a record
    "times its length in fields": 4,  # fields may share few bytes
    # JPEG
    # of 64 KiB: a colour profile, and maps of depth that telephones write, are cut into some
    # hundred
    "segments": 4096,
    # between the segments before the first scan, and 0xFF in a row after it; encoders write a few
    "filling bytes": 1 << 16,
    "scans": 32,  # of a progressive JPEG; encoders make about ten
}
"""Things -> the largest number of them that a file may declare."""


def check_count(number: int, things: str, place: str = "") -> None:
    """Raise InputError if a file declares more of these things than the limit.

    Parameters
    ----------
    place : str, optional
        Where, for the message.
    """
    if number > LIMITS[things]:
        declared = f"the file declares {number} {things}{place}, more than any picture has"
        raise InputError(f"{declared}: it is damaged or malicious; copy it again")
