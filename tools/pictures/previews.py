"""Previews for the commands, made by a graph that ships with the program or by a file from export-preview."""

from typing import TYPE_CHECKING, cast

from shared import Mosaic
from shared.arrays import ByteArray
from shared.errors import InputError

if TYPE_CHECKING:  # onnxruntime is slow to load, and help needs none
    from device import Preview
    from device.capture import PreviewMaker, Sensor


def load_graph(graph: str, scale: int = 1, threads: int | None = None) -> "Preview":
    """Load the preview in a file.

    graph: the file.
    scale: the requested scale; 1 = the graph's own.
    threads: of the preview; None = one per core.

    Raises InputError if the graph cannot be used, makes no picture, or has another scale.
    """
    from device import Preview

    preview = Preview(graph, threads)
    if preview.description.linear:
        raise InputError(f"{graph}: makes scene units, not a picture; run panchroma export-preview without --linear")
    if scale not in (1, preview.description.scale):
        raise InputError(f"{graph}: has scale {preview.description.scale}, not {scale}; leave --scale out")
    return preview


def preview_maker(sensor: "Sensor", *, graph: str | None = None, scale: int = 1, threads: int | None = None) -> "PreviewMaker":
    """Return a camera's preview as a function, loaded and checked before the first frame arrives.

    sensor: the camera's sensor.
    graph: file of the graph; None = the built-in one for the sensor's pattern.
    scale: one pixel for scale x scale of the sensor.
    threads: of the preview; None = one per core.

    Raises InputError if the graph cannot be used, or none fits the sensor.
    """
    from device import Preview

    if graph:
        preview = load_graph(graph, scale, threads)
        try:
            preview.description.check(sensor.pattern)
        except InputError as error:
            raise InputError(f"{graph}: {error}") from None
    else:
        preview = Preview.for_mosaic(sensor.dark(), scale=scale, threads=threads)
    return lambda mosaic: cast(ByteArray, preview.run(mosaic))


class Previews:
    """Makes previews of mosaics with any patterns; loads a graph once per pattern.

    scale: see `Preview.for_mosaic`.
    graph: file of the graph to use for all mosaics; None = the built-in graphs.

    Raises InputError for a scale below 1, and for a graph that cannot be used.
    """

    def __init__(self, scale: int = 1, graph: str | None = None) -> None:
        if scale < 1:
            raise InputError(f"--scale is {scale}, expected 1 or more")
        self._scale = scale
        self._loaded: dict[str, Preview] = {}
        self._given = load_graph(graph, scale) if graph else None

    def __call__(self, mosaic: Mosaic) -> ByteArray:
        """Return the picture, uint8 sRGB (h, w, 3), oriented like the samples. Raises InputError if no graph fits the pattern."""
        from device import Preview
        from device.preview.contract import tile_name

        if self._given:
            return cast(ByteArray, self._given.run(mosaic))
        pattern = f"{tile_name(mosaic.pattern)} {mosaic.pattern.channels}"
        if pattern not in self._loaded:
            self._loaded[pattern] = Preview.for_mosaic(mosaic, self._scale)
        return cast(ByteArray, self._loaded[pattern].run(mosaic))
