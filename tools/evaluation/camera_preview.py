"""The camera's own preview as a method to be compared."""

from typing import cast

from shared import Mosaic
from shared.arrays import FloatArray


def render_preview(mosaic: Mosaic) -> FloatArray:
    """Picture of a shot by the camera's preview graph at full size, float32 (H, W, 3), scene units of the shot."""
    from device import Preview

    return cast(FloatArray, Preview.for_mosaic(mosaic, scale=1, linear=True, threads=1).run(mosaic))
