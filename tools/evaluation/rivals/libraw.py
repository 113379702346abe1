"""DCB by LibRaw, the code behind nearly every free raw developer and many viewers.

LibRaw takes 16-bit integers. Codes have a pedestal, so that noise below black or above white is not
clipped.
"""

import io
from functools import partial

import numpy as np

from ....shared.arrays import CodeArray, FloatArray
from ....shared.dng.tags import CFA_CODES, DNG_VERSION, TAG, Photometric
from ....shared.tiff import FieldType
from ...simulation.bayer import ORDER
from ..cameras import Method, render_samples

_HEADROOM = 1.02  # range of the codes, as a multiple of the samples'


def demosaic_libraw(mosaic: FloatArray) -> FloatArray:
    """DCB's picture, float32 (H, W, 3), of a Bayer mosaic (H, W), scene units. LibRaw refuses
    frames smaller than 22 x 22.
    """
    codes, black, white = encode_codes(mosaic)
    picture = develop(encode_bayer_dng(codes), "DCB")
    return ((picture - np.float32(black)) / np.float32(white - black)).astype(np.float32)


def encode_codes(mosaic: FloatArray) -> tuple[CodeArray, float, float]:
    """Codes of samples in scene units, none clipped, also below 0 and above 1; and the codes of
    black and white.
    """
    low, high = min(0.0, float(mosaic.min())), max(1.0, float(mosaic.max()))
    scale = 65535 / ((high - low) * _HEADROOM)
    black = -low * scale + (65535 - (high - low) * scale) / 2 * (low < 0)
    white = black + scale
    return np.rint(mosaic * (white - black) + black).clip(0, 65535).astype(np.uint16), black, white


def develop(data: bytes, algorithm: str) -> CodeArray:
    """Linear camera colours, uint16 (H, W, 3), that one of LibRaw's algorithms makes of a Bayer
    file in memory.
    """
    import rawpy

    with rawpy.imread(io.BytesIO(data)) as raw:
        developed = raw.postprocess(
            demosaic_algorithm=rawpy.DemosaicAlgorithm[algorithm],
            output_bps=16,
            gamma=(1, 1),
            output_color=rawpy.ColorSpace.raw,
            user_wb=[1.0, 1.0, 1.0, 1.0],
            user_black=0,
            user_sat=65535,
            adjust_maximum_thr=0.0,
            no_auto_bright=True,
            user_flip=0,
        )
    return np.asarray(developed, np.uint16)


def encode_bayer_dng(codes: CodeArray) -> bytes:
    """Uncompressed DNG of a Bayer mosaic, uint16 (H, W): black is 0, white 65535."""
    from tifffile import imwrite

    tags = (
        (TAG["CFARepeatPatternDim"], FieldType.SHORT, 2, (2, 2), True),
        (TAG["CFAPattern"], FieldType.BYTE, 4, bytes(CFA_CODES[letter] for letter in ORDER), True),
        (TAG["DNGVersion"], FieldType.BYTE, 4, bytes(DNG_VERSION), True),
        (TAG["WhiteLevel"], FieldType.LONG, 1, 65535, True),
    )
    file = io.BytesIO()
    imwrite(file, codes, photometric=Photometric.CFA, extratags=tags, metadata=None)
    return file.getvalue()


_render = partial(render_samples, demosaic_libraw)
METHODS = (Method("dcb", "Bayer, LibRaw DCB", _render, balanced=True, packages=("rawpy",)),)
