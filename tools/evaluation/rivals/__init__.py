"""The rivals: a Bayer sensor under the same light, and the ways to make a picture of its mosaic that users have."""

from .bayer import bayer_mosaic
from .bilinear import demosaic_bilinear

__all__ = ["bayer_mosaic", "demosaic_bilinear"]
