"""Scenes in files of every format."""

from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
import tifffile
from PIL import Image


def save(path: Path, light: Any, channels: str = "RGB") -> Path:
    """Write samples (H, W, C), without loss where the format has none, in the format of the name's ending.

    channels: letters of planes that an EXR has by name; a TIFF has planes of grey for other ones than RGB.
    """
    match path.suffix:
        case ".npy":
            np.save(path, light)
        case ".exr":
            header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
            planes = {letter: np.ascontiguousarray(light[..., index]) for index, letter in enumerate(channels)}
            with OpenEXR.File(header, planes) as file:
                file.write(str(path))
        case ".tif" if channels == "RGB":
            tifffile.imwrite(path, light, photometric="rgb", compression="deflate", metadata=None)
        case ".tif":
            tifffile.imwrite(path, np.moveaxis(light, -1, 0).copy(), photometric="minisblack")
        case ".png":
            path.write_bytes(imagecodecs.png_encode(light))
        case _:
            Image.fromarray(light).save(path, lossless=True)
    return path
