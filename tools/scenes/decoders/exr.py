"""OpenEXR pictures."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.colorimetry import as_rows, primaries_to_xyz
from shared.errors import InputError
from shared.reading import data_bytes

from ..icc_reading import LINEAR, Encoding
from ..limited import run_limited
from ..scene import RGB, check_size, scene_channels
from .decoded import Decoded, PictureFormat, guarded


def decode_exr(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode `channels`, what they can be made from, or Y, of the first part of an OpenEXR file; its values are linear."""
    # OpenEXR takes tiles, attributes and further parts of whatever size they declare.
    pixels, found, chromaticities = run_limited(path, ("OpenEXR",), _read_exr, path, max_pixels, channels)
    if pixels.dtype.kind != "f":
        raise InputError(f"the EXR holds whole numbers ({pixels.dtype}), which are labels and no light; save it as half or float")
    if chromaticities is None:
        return Decoded(pixels, None, channels=found)
    red, green, blue, white = chromaticities
    matrix = as_rows(primaries_to_xyz((red, green, blue), white))
    return Decoded(pixels, None, Encoding(LINEAR.curves, matrix, "the file's chromaticities"), channels=found)


def _read_exr(path: Path, max_pixels: int, wanted: str) -> tuple[NDArray[Any], str, list[tuple[float, float]] | None]:
    """Return the pixels (H, W, C), their letters, and x, y of red, green, blue and white if the file has them."""
    with guarded(path):
        import OpenEXR

        header = OpenEXR.File(str(path), header_only=True).header()
        (left, top), (right, bottom) = (np.asarray(corner).tolist() for corner in header["dataWindow"])
        names = {channel.name for channel in header["channels"]}
        choices = [wanted, scene_channels(wanted), RGB]  # the filters' own channels before those they can be made from
        found = next((each for each in choices if set(each) <= names), "Y")
        if not set(found) <= names or "RY" in names:
            expected = "R, G, B" if wanted == RGB else f"{', '.join(wanted)}, or R, G, B"
            raise InputError(f"the EXR has the channels {', '.join(sorted(names))[:200]}; expected {expected}, or Y alone")
        check_size(right - left + 1, bottom - top + 1, 4 * len(names), data_bytes(path), max_pixels)
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
        pixels = np.stack([channels[name].pixels for name in found], axis=-1)
        primaries = header.get("chromaticities")
        corners = None if primaries is None else [(x, y) for x, y in np.reshape(primaries, (4, 2)).tolist()]
        return pixels, RGB if found == "Y" else found, corners


FORMAT = PictureFormat("EXR", rb"\x76\x2f\x31\x01", (".exr",), decode_exr)
