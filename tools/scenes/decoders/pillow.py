"""Pictures of 8 bits, which Pillow decodes: JPEG and most PNGs."""

import warnings
from io import BytesIO
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.errors import InputError

from ..exif_reading import picture_metadata
from ..icc_reading import SRGB, Encoding, power_curve
from ..scene import check_size
from .decoded import NO_ALPHA, Decoded, profile_encoding

_MODES = ("1", "L", "LA", "La", "P", "PA", "RGB", "RGBA", "RGBa", "RGBX")


def with_pillow(data: bytes, max_pixels: int) -> Decoded:
    """Decode an 8-bit PNG or a JPEG whose declared size has been checked."""
    # Invalid capture data cause warnings.
    with warnings.catch_warnings(action="ignore"), pillow().open(BytesIO(data), formats=("PNG", "JPEG")) as image:
        width, height = image.size
        check_size(width, height, 4, len(data), max_pixels)
        if image.mode not in _MODES:
            raise InputError(f"the picture is of kind {image.mode} (CMYK, Lab, ...); convert it to RGB or grey")
        transparent = "A" in image.getbands() or "transparency" in image.info
        grey = image.mode in {"1", "L", "LA", "La"}
        pixels = np.atleast_3d(np.asarray(image.convert("L" if grey else "RGB")))
        return described(image, pixels, 255, (NO_ALPHA,) if transparent else ())


def pillow() -> ModuleType:
    """Return the module PIL.Image with its own size limit switched off: `check_size` runs before anything is decoded."""
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = None
    return Image


def described(image: Any, pixels: NDArray[Any], peak: int, notes: tuple[str, ...]) -> Decoded:
    """Return the pixels with what Pillow's `image` says about them: encoding and capture data."""
    encoding, remarks = png_encoding(image.info)
    return Decoded(pixels, peak, encoding, picture_metadata(image.info), notes + remarks)


def png_encoding(info: dict[Any, Any]) -> tuple[Encoding | None, tuple[str, ...]]:
    """Return the encoding that Pillow's `info` declares, and notes: profile before sRGB before gamma (PNG, third edition, 4.3)."""
    if info.get("icc_profile"):
        return profile_encoding(info["icc_profile"])
    gamma = info.get("gamma")
    if "srgb" in info or (gamma and abs(gamma - 1 / 2.2) < 0.005):  # sRGB files give this gamma for old readers
        return SRGB, ()
    if gamma and 0.1 < gamma < 10:
        return Encoding((power_curve(1 / gamma),) * 3, SRGB.to_xyz, f"gamma {gamma:.4g}"), ()
    return None, ()
