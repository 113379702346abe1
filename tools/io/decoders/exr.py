"""OpenEXR pictures."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.errors import InputError

from ..encoding import Encoding, space_of
from ..file_size import data_bytes
from ..limited import Facts, run_limited
from ..scene import RGB, check_size, scene_channels
from .decoded import MOST_PAGES, Decoded, PictureFormat, guarded, remark_on_unused


def decode_exr(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode `channels`, what they can be made from, or Y, of the first part of an OpenEXR file; its values are linear."""
    # OpenEXR takes tiles, attributes and further parts of whatever size they declare.
    pixels, facts = run_limited(path, ("OpenEXR",), unpack_exr, str(path), max_pixels, channels)
    if pixels.dtype.kind != "f" or pixels.ndim != 3:
        raise InputError(f"the EXR holds whole numbers ({pixels.dtype}), which are labels and no light; save it as half or float")
    stated, unused = facts["chromaticities"], [str(name) for name in facts["unused"]]
    matrix = space_of(stated) if stated else None
    unused += ["its chromaticities, which are those of no colours"] if stated and not matrix else []
    encoding = Encoding((), matrix, "the file's chromaticities") if matrix else None
    return Decoded(pixels, None, encoding, notes=remark_on_unused(unused), channels=str(facts["channels"]))


def unpack_exr(path: str, max_pixels: int, wanted: str) -> tuple[NDArray[Any], Facts]:
    """Return the pixels (H, W, C), their letters, x, y of red, green, blue and white if the file has them, and what it has besides.

    Call it by `run_limited`.
    """
    with guarded(path):
        import OpenEXR

        first = OpenEXR.File(path, header_only=True)
        header, parts = first.header(), len(first.parts)
        (left, top), (right, bottom) = (np.asarray(corner).tolist() for corner in header["dataWindow"])
        names = {channel.name for channel in header["channels"]}
        choices = [wanted, scene_channels(wanted), RGB]  # the filters' own channels before those they can be made from
        found = next((each for each in choices if set(each) <= names), "Y")
        if not set(found) <= names or "RY" in names:
            expected = "R, G, B" if wanted == RGB else f"{', '.join(wanted)}, or R, G, B"
            raise InputError(f"the EXR has the channels {', '.join(sorted(names))[:200]}; expected {expected}, or Y alone")
        check_size(right - left + 1, bottom - top + 1, 4 * len(names), data_bytes(path), max_pixels)
        channels = OpenEXR.File(path, separate_channels=True).channels()
        pixels = np.stack([channels[name].pixels for name in found], axis=-1)
        primaries = header.get("chromaticities")
        unused = [f"channel {name[:40]}" for name in sorted(names - set(found))[:MOST_PAGES]]
        unused += [f"{parts - 1} more parts"] if parts > 1 else []
        corners = None if primaries is None else np.ravel(np.asarray(primaries, np.float64)).tolist()
        return pixels, {"channels": RGB if found == "Y" else found, "chromaticities": corners, "unused": unused}


FORMAT = PictureFormat("EXR", rb"\x76\x2f\x31\x01", (".exr",), decode_exr)
