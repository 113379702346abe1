"""The camera's previews of shots with any patterns."""

from typing import TYPE_CHECKING, cast

from ...shared import ByteArray, CfaPattern, FloatArray, InputError, Mosaic
from ...shared.figures import whole

if TYPE_CHECKING:  # onnxruntime is slow to load, and help needs none
    from ...device import Preview


class Previews:
    """Makes previews of mosaics with any patterns; builds a graph once per pattern.

    scale: see `Preview`. threads: see `Preview`. Raises InputError for a scale below 1.
    """

    def __init__(self, scale: int = 1, threads: int | None = None) -> None:
        scale = whole("`scale`", scale)
        if scale < 1:
            raise InputError(f"`scale` is {scale}, expected 1 or more")
        self._scale, self._threads = scale, threads
        self._built: dict[CfaPattern, Preview] = {}

    def __call__(self, mosaic: Mosaic) -> ByteArray:
        """Return the picture, uint8 sRGB (h, w, 3), oriented like the samples.

        Raises InputError without such a scale.
        """
        from ...device import Preview

        # wherever it begins, the graph is the same
        pattern = mosaic.pattern.cropped(*mosaic.pattern.origin)
        if pattern not in self._built:
            self._built[pattern] = Preview(pattern, self._scale, threads=self._threads)
        return cast(ByteArray, self._built[pattern].run(mosaic))


def linear_preview(mosaic: Mosaic) -> FloatArray:
    """The camera's preview of a shot at full size, without display processing: float32 (H, W, 3),
    scene units of the shot.
    """
    from ...device import Preview

    return cast(FloatArray, Preview(mosaic.pattern, linear=True, threads=1).run(mosaic))
