"""Codes without shading, for a preview graph, which knows none.

A graph takes any 16-bit codes, with their black level and scale as inputs, and its sums over them
are exact. So the gain is applied to the codes, which become as fine as 16 bits allow: for 12 bits
and two stops no coarser than before.
"""

import numpy as np

from ...shared.arrays import CodeArray, FloatArray, strips
from ...shared.mosaic import Mosaic
from . import contract

_HIGHEST = (1 << 16) - 1


def correct_flat_field(mosaic: Mosaic) -> tuple[CodeArray, dict[str, FloatArray]]:
    """The codes of a mosaic without its shading, uint16 (H, W), and the graph's inputs that say
    what they mean.

    Its own codes, and no inputs, where it has no shading.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.device.preview.flat_field import correct_flat_field
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration, Shading
    >>> calibration = SensorCalibration.of_bits(12, shading=Shading(np.ones((4, 4, 4)).tolist(),
    ...     (12, 18)))
    >>> mosaic = Mosaic(np.full((12, 18), 3839, np.uint16), CfaPattern.bayer(6), calibration)
    >>> codes, levels = correct_flat_field(mosaic)
    >>> round(float((codes[5, 5] - levels["black"][-1]) * levels["scale"][-1]), 3)  # scene units
    3.0
    """
    calibration = mosaic.calibration
    if calibration.shading is None:
        return mosaic.codes, {}
    black, scale = np.array(calibration.black_level), calibration.scale()
    # Codes below black, which noise makes, stay above 0.
    most = float(calibration.shading.sketch.max())
    finer = _HIGHEST / ((1 << calibration.bits) * most)
    offset = float(np.ceil(black.max() * most * finer))
    codes, even = mosaic.codes, np.empty(mosaic.shape, np.uint16)
    panchromatic = ((-1, rows, slice(None)) for rows in strips(mosaic.shape[0]))
    for plane, *lattice in (*panchromatic, *mosaic.pattern.lattices):
        level = codes[*lattice] - np.float32(black[plane])
        level *= calibration.shading.of_plane(mosaic.shape, plane, *lattice)
        level *= np.float32(finer)
        level += np.float32(offset)
        even[*lattice] = np.rint(level, out=level).clip(0, _HIGHEST, out=level)
    levels = {contract.BLACK: np.full(len(black), offset), contract.SCALE: scale / finer}
    return even, {name: level.astype(np.float32) for name, level in levels.items()}
