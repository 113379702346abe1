"""Previews for the commands: of a camera's frames, and of shots with any patterns."""

from typing import TYPE_CHECKING, cast

from shared import Mosaic
from shared.arrays import ByteArray, FloatArray
from shared.errors import InputError

if TYPE_CHECKING:  # onnxruntime is slow to load, and help needs none
    from device import Preview
    from device.capture import PreviewMaker, Sensor


def preview_maker(sensor: "Sensor", *, scale: int = 1, threads: int | None = None) -> "PreviewMaker":
    """Return a camera's preview as a function, ready before the first frame arrives.

    sensor: the camera's sensor.
    scale: one pixel for scale x scale of the sensor.
    threads: of the preview; None = one per core.
    Raises InputError if the sensor's pattern has no such scale.
    """
    from device import Preview

    preview = Preview(sensor.pattern, scale, threads=threads)
    return lambda mosaic: cast(ByteArray, preview.run(mosaic))


class Previews:
    """Makes previews of mosaics with any patterns; builds a graph once per pattern.

    scale: see `Preview`.
    Raises InputError for a scale below 1.
    """

    def __init__(self, scale: int = 1) -> None:
        if scale < 1:
            raise InputError(f"`scale` is {scale}, expected 1 or more")
        self._scale = scale
        self._built: dict[str, Preview] = {}

    def __call__(self, mosaic: Mosaic) -> ByteArray:
        """Return the picture, uint8 sRGB (h, w, 3), oriented like the samples. Raises InputError without such a scale."""
        from device import Preview
        from device.preview.contract import tile_name

        pattern = f"{tile_name(mosaic.pattern)} {mosaic.pattern.channels}"
        if pattern not in self._built:
            self._built[pattern] = Preview(mosaic.pattern, self._scale)
        return cast(ByteArray, self._built[pattern].run(mosaic))


def linear_preview(mosaic: Mosaic) -> FloatArray:
    """The camera's preview of a shot at full size, without display processing: float32 (H, W, 3), scene units of the shot."""
    from device import Preview

    return cast(FloatArray, Preview.for_mosaic(mosaic, scale=1, linear=True, threads=1).run(mosaic))


def preview_version() -> str:
    """Version of the graphs that make previews."""
    from device.preview.graph import BUILDER

    return BUILDER
