"""Running a preview graph on a mosaic, in strips of rows, which fit into the cache of the
processor.
"""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...shared import ByteArray, CfaPattern, FloatArray, InputError, Mosaic, SensorCalibration
from ...shared.display import display_white
from ...shared.processors import threads as chosen_threads
from ...shared.runtime import session
from . import contract
from .codes import copy_extended, correct_flat_field, without_defects
from .geometry import REACH, Geometry
from .graph import build_preview

_STRIP_PIXELS = 1 << 17
"""Sensor pixels per strip at full resolution; five times as many for smaller pictures. Their planes
fit into 2 MB of cache.
"""


class Preview:
    """A preview graph, loaded once, for any number of mosaics of its pattern, of any size and
    origin.

    Parameters
    ----------
    pattern : CfaPattern
        The filter pattern; its origin does not matter.
    scale : int, optional
        Sensor pixels per picture pixel, each way; one of `Geometry.scales(pattern)`.
    linear : bool, optional
        Scene units instead of a picture for a screen.
    threads : int | None, optional
        Number of strips that are processed at a time; None = as `shared.processors.threads` says
        where it is run.

    Raises
    ------
    InputError
        When the pattern has no preview of this scale.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.device import Preview
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> pattern = CfaPattern.bayer(6)
    >>> white = np.where(pattern.panchromatic_mask((120, 180)), 3.0, 1.0)  # scene units
    >>> mosaic = Mosaic(white, pattern, SensorCalibration.of_bits(12))
    >>> picture = Preview.for_mosaic(mosaic, scale=3).run(mosaic)
    >>> picture.shape, picture[20, 30].tolist()
    ((40, 60, 3), [255, 255, 255])
    """

    def __init__(
        self,
        pattern: CfaPattern,
        scale: int = 1,
        *,
        linear: bool = False,
        threads: int | None = None,
    ) -> None:
        if threads is not None and threads < 1:
            raise InputError(f"`threads` is {threads}, expected 1 or more")
        self._geometry, self._linear = Geometry(pattern, scale), linear
        # What was just computed is in the cache: 3 % less time. At full resolution, with a chain of
        # nodes per pixel, it is more.
        self._session = session(build_preview(pattern, scale, linear=linear), as_written=scale > 1)
        self._threads = threads

    @classmethod
    def for_mosaic(
        cls, mosaic: Mosaic, scale: int = 1, linear: bool = False, threads: int | None = None
    ) -> "Preview":
        """The preview for all mosaics with the pattern of this one; for the rest see the class."""
        return cls(mosaic.pattern, scale, linear=linear, threads=threads)

    def run(self, mosaic: Mosaic) -> ByteArray | FloatArray:
        """The picture of a mosaic: uint8 sRGB (h, w, 3), or float32 scene units (h, w, C) of a
        linear graph.

        h = H // scale, w = W // scale (at least 1), in the orientation of the samples. Channels of
        unknown colours are shown in grey.

        Raises
        ------
        InputError
            For a mosaic of another pattern.
        """
        pattern, scale, linear = mosaic.pattern, self._geometry.scale, self._linear
        self._check(pattern)
        middles = zip(mosaic.shape, pattern.block_middle, strict=True)
        rows, columns = (_Axis(size, middle, pattern.period, scale) for size, middle in middles)
        above, below, left, right = self._geometry.halo
        even, levels = correct_flat_field(mosaic)
        codes = without_defects(even, pattern, mosaic.calibration.defects)
        inputs = self._inputs(mosaic.calibration) | levels
        gain = _gain(mosaic, rows, columns)
        channels, kind = (len(pattern.channels), np.float32) if linear else (3, np.uint8)
        picture = np.empty((rows.size, columns.size, channels), kind)
        width, sample_type = columns.patches * pattern.period, "u2" if scale == 1 else "f4"

        most = max(1, _STRIP_PIXELS * (1 if scale == 1 else 5) // (width * pattern.period))
        count = -(-rows.patches // most)
        # strips of nearly equal length
        edges = [rows.patches * number // count for number in range(count + 1)]
        # that of a list may be shared by threads
        strips = iter([range(first, end) for first, end in pairwise(edges)])

        # one task per thread, not per strip: handing over each strip takes 6 % longer (12 MP)
        def work(_: int) -> None:
            tallest = above + min(rows.patches, most) * pattern.period + below
            buffer = np.empty((tallest, left + width + right), sample_type)
            for patches in strips:
                cut = buffer[: above + len(patches) * pattern.period + below]
                top = rows.first + patches.start * pattern.period - above
                copy_extended(codes, pattern.period, top, columns.first - left, cut)
                blocks = slice(patches.start, patches.stop + 1 + 2 * REACH[0])
                feeds = {contract.MOSAIC: cut, **inputs}
                feeds[contract.GAIN] = gain[blocks] if len(gain) > 1 else gain
                (strip,) = self._session.run([contract.PICTURE], feeds)
                begin = patches.start * pattern.period // scale - rows.skip
                target = picture[max(begin, 0) : begin + len(strip)]
                first = max(-begin, 0)
                target[:] = strip[first : first + len(target), columns.skip :][:, : columns.size]

        # A pool of its own for each picture: one that stays would wait for ever for a thread whose
        # start is interrupted.
        threads = self._threads or chosen_threads()
        with ThreadPoolExecutor(threads, "preview") as pool:
            list(pool.map(work, range(threads)))  # raises an error of a strip
        return picture

    def _check(self, pattern: CfaPattern) -> None:
        """Raise InputError unless the graph was made for this pattern."""
        own = self._geometry.pattern
        patterns = [contract.tile_name(each) for each in (own, pattern)]
        channels = [own.channels, pattern.channels]
        for name, (ours, other) in {"pattern": patterns, "channels": channels}.items():
            if ours != other:
                raise InputError(f"the preview is for the {name} {ours}, the mosaic has {other}")

    def _inputs(self, calibration: SensorCalibration) -> dict[str, NDArray[Any]]:
        """All inputs of the graph except the mosaic."""
        noise = calibration.noise
        inputs: dict[str, Any] = {
            contract.BLACK: calibration.black_level,
            contract.SCALE: calibration.scale(),
            contract.GAMMA: calibration.gamma,
            contract.NOISE: (noise.shot[-1], noise.read[-1] ** 2) if noise else (0, 0),
        }
        if not self._linear:
            inputs[contract.WHITE], inputs[contract.MATRIX] = _balance(calibration)
        return {name: np.asarray(value, np.float32) for name, value in inputs.items()}


class _Axis:
    """Patches and picture pixels along one axis of a frame.

    first: sensor pixel at which the first patch begins, 0 or less.
    patches: number of patches.
    skip: picture pixels that the patches have before the picture begins. The picture begins with
    the pixel that covers the middle
        of the first `scale` pixels of the frame.
    size: number of picture pixels.
    period: K.
    """

    def __init__(self, size: int, middle: int, period: int, scale: int) -> None:
        self.period, self.first = period, -(-middle % period)
        self.skip = ((scale - 1) // 2 - self.first) // scale
        self.size = max(size // scale, 1)
        self.patches = -(-(self.skip + self.size) * scale // period)


def _gain(mosaic: Mosaic, rows: _Axis, columns: _Axis) -> FloatArray:
    """Gain that undoes shading at each block that is read, (down, across); (1, 1) without."""
    shading, ones = mosaic.calibration.shading, np.ones((1, 1), np.float32)
    if shading is None:
        return ones
    middles = [
        (axis.first + axis.period * np.arange(-reach, axis.patches + 1 + reach)).clip(0, size - 1)
        for axis, size, reach in zip((rows, columns), mosaic.shape, REACH, strict=True)
    ]
    return np.ascontiguousarray(shading.of_plane(mosaic.shape)[np.ix_(*middles)])


def _balance(calibration: SensorCalibration) -> tuple[NDArray[Any], NDArray[Any]]:
    """Display white, and the matrix from camera RGB relative to white -> linear sRGB. Unknown
    colours become grey.
    """
    try:
        white, matrix = display_white(calibration)
    except InputError:
        white = np.full(len(calibration.channels), calibration.full_scale)
        return white, np.tile(np.array(calibration.gamma), (3, 1))
    return white, matrix * white
