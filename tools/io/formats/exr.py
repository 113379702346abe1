"""OpenEXR, with the capture data as standard optional attributes."""

import tempfile
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, ClassVar

import numpy as np

from ....shared import CaptureMetadata, OutputError
from ....shared.colorimetry import D65_XY
from ..development import CAMERA, Development, software
from ..display import SPACES
from .format import Bands, Format


class OpenExr(Format):
    """OpenEXR; 16 bits are half floats.

    Raises OutputError if a temporary file cannot be written.
    """

    name = "exr"
    spaces: ClassVar = {"linear-srgb": (16, 32), CAMERA: (32, 16)}
    memory_per_pixel = 40.0

    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Implement `Format`."""
        import OpenEXR

        (pixels,), kind, compression = bands, development.kind, OpenEXR.NO_COMPRESSION
        if kind.bits == 16:
            largest = float(np.finfo(np.float16).max)
            with np.errstate(under="ignore"):  # whatever the caller's program asks for
                pixels = pixels.clip(-largest, largest).astype(np.float16)
            # ZIP saves 40 % of half floats, but only 5 % of floats (their last bits are noise), for
            # which it takes too long.
            compression = OpenEXR.ZIP_COMPRESSION
        attributes = _attributes(development.noted, kind.space)
        header = {"compression": compression, "type": OpenEXR.scanlineimage, **attributes}
        planes = np.ascontiguousarray(np.moveaxis(pixels, -1, 0))
        channels = dict(zip(development.channels, planes, strict=True))
        try:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "picture.exr"  # OpenEXR before 3.5 writes to no stream
                OpenEXR.File(header, channels).write(str(path))
                data = path.read_bytes()
        except (OSError, RuntimeError) as error:
            remedy = "set TMPDIR to a folder with free space"
            raise OutputError(f"no temporary file for OpenEXR ({error}); {remedy}") from error
        file.write(data)


def _attributes(metadata: CaptureMetadata, space: str) -> dict[str, Any]:
    """The capture data, and the chromaticities if they are known."""
    attributes: dict[str, Any] = {
        "cameraMake": metadata.make,
        "cameraModel": metadata.model,
        "lensModel": metadata.lens,
        "owner": metadata.artist,
        "copyright": metadata.copyright,
        "comments": metadata.description,
        "capDate": metadata.taken and metadata.taken.strftime("%Y:%m:%d %H:%M:%S"),
        "expTime": metadata.exposure_time,
        "aperture": metadata.f_number,
        "isoSpeed": metadata.iso and float(metadata.iso),
        "nominalFocalLength": metadata.focal_length,
    }
    attributes = {name: value for name, value in attributes.items() if value}
    if metadata.place:
        attributes["latitude"], attributes["longitude"] = metadata.place
    if metadata.altitude is not None:
        attributes["altitude"] = metadata.altitude
    attributes["software"] = software()
    if space in SPACES:
        attributes["chromaticities"] = tuple(chain(*SPACES[space].primaries, D65_XY))
    else:  # not a standard name, but OpenImageIO reads it
        attributes["Orientation"] = metadata.orientation
    return attributes
