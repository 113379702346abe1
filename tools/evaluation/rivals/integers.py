"""Rivals that take 16-bit integers: LibRaw, the code behind nearly every free raw developer and many viewers, and OpenCV.

Each `demosaic` function makes a picture, float32 (H, W, 3), of a Bayer mosaic (H, W), both in scene units. Codes have a pedestal,
so that noise below black or above white is not clipped.
"""

import io
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.arrays import FloatArray
from shared.dng.tags import CFA_CODES, DNG_VERSION, TAG, Photometric
from shared.tiff import FieldType
from tools.io.versions import package_version
from tools.simulation.bayer import ORDER

from ..method import Method

LIBRAW = ("ahd", "dcb", "dht", "aahd")
"""LibRaw's algorithms."""
# Distributions that all install the module cv2.
_OPENCV = ("opencv-contrib-python-headless", "opencv-python-headless", "opencv-contrib-python", "opencv-python")


@dataclass(frozen=True)
class Levels:
    """A linear encoding: code = black + value * (white - black); 1 scene unit is the code `white`."""

    black: float
    white: float

    @classmethod
    def around(cls, mosaic: FloatArray, headroom: float = 1.02) -> "Levels":
        """Levels between which every sample of a mosaic fits, also below 0 and above 1, so that none is clipped."""
        low, high = min(0.0, float(mosaic.min())), max(1.0, float(mosaic.max()))
        scale = 65535 / ((high - low) * headroom)
        black = -low * scale + (65535 - (high - low) * scale) / 2 * (low < 0)
        return cls(black, black + scale)

    def encode(self, values: FloatArray) -> NDArray[np.uint16]:
        """Codes, uint16, of values in scene units."""
        return np.rint(values * (self.white - self.black) + self.black).clip(0, 65535).astype(np.uint16)

    def decode(self, codes: NDArray[np.uint16]) -> FloatArray:
        """Values in scene units, float32, of codes."""
        return ((codes - np.float32(self.black)) / np.float32(self.white - self.black)).astype(np.float32)


def demosaic_libraw(mosaic: FloatArray, algorithm: str) -> FloatArray:
    """LibRaw's picture of a Bayer DNG in memory. algorithm: one of LIBRAW. LibRaw refuses frames smaller than 22 x 22."""
    levels = Levels.around(mosaic)
    return levels.decode(develop(encode_bayer_dng(levels.encode(mosaic)), algorithm))


def demosaic_opencv(mosaic: FloatArray) -> FloatArray:
    """OpenCV's edge-aware interpolation."""
    levels = Levels.around(mosaic)
    return levels.decode(edge_aware(levels.encode(mosaic)))


def develop(data: bytes, algorithm: str) -> NDArray[np.uint16]:
    """Linear camera colours, uint16 (H, W, 3), that one of LibRaw's algorithms makes of a Bayer file in memory."""
    import rawpy

    with rawpy.imread(io.BytesIO(data)) as raw:
        developed: Any = raw.postprocess(
            demosaic_algorithm=rawpy.DemosaicAlgorithm[algorithm.upper()],
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


def encode_bayer_dng(codes: NDArray[np.uint16]) -> bytes:
    """Uncompressed DNG of a Bayer mosaic, uint16 (H, W): black is 0, white 65535, camera colours are those of sRGB."""
    from tifffile import imwrite

    # XYZ -> linear sRGB (IEC 61966-2-1), under D65: AHD compares colours in CIE Lab and needs a matrix.
    matrix = (3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.204, 1.057)
    fields = (
        (TAG["CFARepeatPatternDim"], FieldType.SHORT, 2, (2, 2)),
        (TAG["CFAPattern"], FieldType.BYTE, 4, bytes(CFA_CODES[letter] for letter in ORDER)),
        (TAG["DNGVersion"], FieldType.BYTE, 4, bytes(DNG_VERSION)),
        (TAG["UniqueCameraModel"], FieldType.ASCII, 0, "Panchroma Bayer rival"),
        (TAG["WhiteLevel"], FieldType.LONG, 1, 65535),
        (TAG["ColorMatrix1"], FieldType.SRATIONAL, 9, tuple(part for each in matrix for part in (round(10000 * each), 10000))),
        (TAG["CalibrationIlluminant1"], FieldType.SHORT, 1, 21),
        (TAG["AsShotNeutral"], FieldType.RATIONAL, 3, (1, 1) * 3),
    )
    file = io.BytesIO()
    imwrite(file, codes, photometric=Photometric.CFA, extratags=[(*field, True) for field in fields], metadata=None)
    return file.getvalue()


def edge_aware(codes: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """OpenCV's edge-aware interpolation itself: 16-bit codes (H, W) to (H, W, 3)."""
    import cv2

    # The old name of RGGB, which every version has: that of the second and third pixel of the second row.
    return np.asarray(cv2.demosaicing(codes, cv2.COLOR_BayerBG2RGB_EA), np.uint16)


_INSTALLED = next((name for name in _OPENCV if package_version(name)), _OPENCV[0])
_LIBRAW = {name: partial(demosaic_libraw, algorithm=name) for name in LIBRAW}
METHODS = (
    *(
        Method(name, f"Bayer, LibRaw {name.upper()}", function, balanced=True, packages=("rawpy",), seconds=0.2)
        for name, function in _LIBRAW.items()
    ),
    Method("ea", "Bayer, OpenCV edge-aware", demosaic_opencv, packages=(_INSTALLED,), seconds=0.05),
)
