"""Running a preview graph on a mosaic, in strips of rows, which fit into the cache of the processor."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.arrays import ByteArray, CodeArray, FloatArray
from shared.calibration import SensorCalibration
from shared.display import ColourTransform
from shared.errors import InputError
from shared.mosaic import Mosaic
from shared.pattern import CfaPattern
from shared.reading import read_whole
from shared.runtime import onnxruntime

from . import contract
from .border import ExtendedFrame
from .even_light import even_light
from .graph_check import check_graph
from .listed_defects import without_defects

_STRIP_PIXELS = 1 << 17
"""Sensor pixels per strip at full resolution; five times as many for smaller pictures. Their planes fit into 2 MB of cache."""

_DAMAGED = "it is damaged; write it again: panchroma export-preview"
_LARGEST_GRAPH = 2 << 20  # bytes; those that ship have less than thirty thousand, with 240 scattered sites 1.8 million


class Preview:
    """A preview graph, loaded once, for any number of mosaics of its pattern, of any size and origin.

    model: path of a graph (`panchroma export-preview` writes one), or its bytes.
    threads: number of strips that are processed at a time; None = the number of processors that this process may use.
    Raises InputError when the model cannot be read, or has another version of the contract.

    >>> import numpy as np
    >>> from device import Preview
    >>> from shared import CfaPattern, Mosaic, SensorCalibration
    >>> pattern = CfaPattern.bayer(6)
    >>> white = np.where(pattern.panchromatic_mask((120, 180)), 3.0, 1.0)  # a white surface, scene units
    >>> mosaic = Mosaic(white, pattern, SensorCalibration.of_bits(12))
    >>> picture = Preview.for_mosaic(mosaic, scale=3).run(mosaic)
    >>> picture.shape, picture[20, 30].tolist()
    ((40, 60, 3), [255, 255, 255])
    """

    def __init__(self, model: Path | str | bytes, threads: int | None = None) -> None:
        if threads is not None and threads < 1:
            raise InputError(f"a preview with {threads} threads: at least one is needed")
        self._session = _session(model)
        try:
            metadata = self._session.get_modelmeta().custom_metadata_map
        except UnicodeDecodeError as error:
            raise InputError(f"the preview graph's description is no text ({error}): {_DAMAGED}") from None
        self.description = contract.parse(metadata)
        self._threads = threads or _processors()

    @classmethod
    def for_mosaic(cls, mosaic: Mosaic, scale: int = 1, linear: bool = False, threads: int | None = None) -> "Preview":
        """The preview for all mosaics of a pattern: a graph from the package, or one built now if `onnx` is installed.

        mosaic: any mosaic with the pattern.
        scale: sensor pixels per picture pixel, each way; a divisor of the period.
        linear: scene units instead of a picture for a screen.
        threads: number of strips that are processed at a time; None = the number of processors that this process may use.
        Raises InputError when there is no such graph.
        """
        return cls(find_model(mosaic.pattern, scale, linear=linear), threads)

    def run(self, mosaic: Mosaic) -> ByteArray | FloatArray:
        """The picture of a mosaic: uint8 sRGB (h, w, 3), or float32 scene units (h, w, C) of a linear graph.

        h = H // scale, w = W // scale (at least 1), in the orientation of the samples. Channels of unknown colours are shown in
        grey.
        Raises InputError for a mosaic of another pattern.
        """
        pattern, description = mosaic.pattern, self.description
        description.check(pattern)
        rows, columns = (
            _Axis.of(size, origin, block, pattern.period, description.scale)
            for size, origin, block in zip(mosaic.shape, pattern.block_origin, pattern.block_shape, strict=True)
        )
        above, below, left, right = description.halo
        even, levels = even_light(mosaic)
        inputs = self._inputs(mosaic.calibration) | levels
        black, scale, grey = inputs[contract.BLACK], inputs[contract.SCALE], 1 / mosaic.calibration.full_scale
        codes = without_defects(even, pattern, mosaic.calibration.defects, black, scale, grey)
        frame = ExtendedFrame(codes, pattern, rows.span(above, below), columns.span(left, right))
        channels = len(pattern.channels) if description.linear else 3
        picture = np.empty((rows.size, columns.size, channels), np.float32 if description.linear else np.uint8)
        width = columns.patches * pattern.period
        strip_size = width // description.scale, channels

        def develop(patches: range) -> None:
            count = len(patches) * pattern.period
            cut = np.empty((above + count + below, left + width + right), np.uint16)
            frame.copy_rows(rows.first + patches.start * pattern.period - above, cut)
            strip = self._strip(cut, inputs)
            if strip.dtype != picture.dtype or strip.shape != (count // description.scale, *strip_size):
                raise InputError(f"the preview graph returns {strip.dtype} {strip.shape} for a strip: {_DAMAGED}")
            begin = patches.start * pattern.period // description.scale - rows.skip
            target = picture[max(begin, 0) : begin + len(strip)]
            first = max(-begin, 0)
            target[:] = strip[first : first + len(target), columns.skip : columns.skip + columns.size]

        most = _STRIP_PIXELS * (1 if description.scale == 1 else 5) // (width * pattern.period)
        strips, taking = _strips(rows.patches, max(1, most)), Lock()

        def work(_: int) -> None:  # one task per thread, not per strip: handing over each strip takes 6 % longer (12 MP)
            while True:
                with taking:
                    patches = next(strips, None)
                if patches is None:
                    return
                develop(patches)

        # A pool of its own for each picture: one that stays would wait for ever for a thread whose start is interrupted.
        with ThreadPoolExecutor(self._threads, "preview") as pool:
            for _ in pool.map(work, range(self._threads)):
                pass  # raises an error of a strip
        return picture

    def _strip(self, codes: CodeArray, inputs: dict[str, NDArray[Any]]) -> NDArray[Any]:
        try:
            (strip,) = self._session.run([contract.PICTURE], {contract.MOSAIC: codes, **inputs})
        except MemoryError:
            raise
        except Exception as error:  # onnxruntime's errors have no common base class
            raise InputError(f"the preview graph does not run ({error}): {_DAMAGED}") from error
        return np.asarray(strip)

    def _inputs(self, calibration: SensorCalibration) -> dict[str, NDArray[Any]]:
        """All inputs of the graph except the mosaic."""
        noise = calibration.noise
        inputs: dict[str, Any] = {
            contract.BLACK: calibration.black_level,
            contract.SCALE: calibration.scale(),
            contract.GAMMA: calibration.gamma,
            contract.NOISE: (noise.shot[-1], noise.read[-1] ** 2) if noise else (0, 0),
        }
        if not self.description.linear:
            inputs |= dict(zip((contract.WHITE, contract.MATRIX), _balance(calibration), strict=True))
        return {name: np.asarray(value, np.float32) for name, value in inputs.items()}


@dataclass(frozen=True)
class _Axis:
    """Patches and picture pixels along one axis of a frame.

    first: sensor pixel at which the first patch begins, 0 or less.
    patches: number of patches.
    skip: picture pixels that the patches have before the picture begins. The picture begins with the pixel that covers the middle
        of the first `scale` pixels of the frame.
    size: number of picture pixels.
    period: K.
    """

    first: int
    patches: int
    skip: int
    size: int
    period: int

    @classmethod
    def of(cls, size: int, origin: int, block: int, period: int, scale: int) -> "_Axis":
        first = -(-(origin + block // 2) % period)
        skip = ((scale - 1) // 2 - first) // scale
        pixels = max(size // scale, 1)
        return cls(first, -(-(skip + pixels) * scale // period), skip, pixels, period)

    def span(self, before: int, after: int) -> tuple[int, int]:
        """(first, last + 1) sensor pixel of the patches, extended by `before` and `after` pixels."""
        return self.first - before, self.first + self.patches * self.period + after


def find_model(pattern: CfaPattern, scale: int, *, linear: bool) -> Path | bytes:
    """The graph for a pattern: the path of one in the package, or the bytes of one built now, which needs `onnx`.

    pattern: the filter pattern.
    scale: sensor pixels per picture pixel, each way.
    linear: scene units instead of a picture for a screen.
    Raises InputError when there is no such graph in the package and `onnx` is not installed, or when the pattern has no such scale.
    """
    path = Path(__file__).parent / "models" / contract.file_name(pattern, scale, linear=linear)
    if pattern.channels == "RGB" and not pattern.is_scattered and path.exists():
        return path
    try:
        from .graph import build_preview
    except ImportError:
        raise InputError(
            f"this program comes without a preview graph for the pattern {'/'.join(pattern.tile)} at scale {scale}, and builds one "
            "only where the package onnx is: pip install onnx, or run panchroma export-preview on a machine with onnx and give its "
            "file with `graph`"
        ) from None
    graph: bytes = build_preview(pattern, scale, linear=linear).SerializeToString(deterministic=True)
    return graph


def _session(model: Path | str | bytes) -> Any:
    """An onnxruntime session for the graph, which computes in the calling thread."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # strips run in parallel instead
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 4  # errors are raised anyway
    name = "the preview graph" if isinstance(model, bytes) else str(model)
    try:
        data = model if isinstance(model, bytes) else read_whole(model, _LARGEST_GRAPH, "a preview graph")
        check_graph(data)
        return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    except Exception as error:  # each error code of onnxruntime has its own class, without a common base
        raise InputError(f"{name}: is not a graph that onnxruntime can run ({error})") from error


def _balance(calibration: SensorCalibration) -> tuple[NDArray[Any], NDArray[Any]]:
    """Display white, and the matrix from camera RGB relative to white -> linear sRGB. Unknown colours become grey."""
    try:
        transform = ColourTransform.to_space(calibration)
    except InputError:
        white = np.full(len(calibration.channels), calibration.full_scale)
        return white, np.tile(np.array(calibration.gamma), (3, 1))
    return np.array(transform.white), np.array(transform.matrix) * transform.white


def _strips(patches: int, most: int) -> Iterator[range]:
    """Divide the rows of patches into ranges of at most `most`, of nearly equal length."""
    count = -(-patches // most)
    edges = [patches * number // count for number in range(count + 1)]
    return map(range, edges[:-1], edges[1:])


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
