"""The camera's own preview as a method to be compared."""

from typing import cast

from shared import Mosaic
from shared.arrays import FloatArray


def render_preview(mosaic: Mosaic) -> FloatArray:
    """Render a shot with the camera's preview graph at full size. Returns float32 (H, W, 3), scene units of the shot."""
    from device import Preview

    return cast(FloatArray, Preview.for_mosaic(mosaic, scale=1, linear=True, threads=1).run(mosaic))
