"""Gehler's colour-checker photographs as L. Shi and B. Funt publish them: 16-bit PNG that hold 12-bit camera samples.

Every 2 x 2 quad of the Bayer sensor is one pixel already. The numbers are as the camera wrote them: a Canon 5D adds 129 to them
(files IMG_NNNN), a Canon 1D adds nothing (files 8D5UNNNN). The paper's ten scenes are of this set.
"""

import re

import numpy as np

from .decoders import Decoded
from .picture import Range

_CAMERAS = ((re.compile(r"IMG_\d{4}"), 129, "Canon 5D"), (re.compile(r"8D5U\d{4}"), 0, "Canon 1D"))
_WHITE = 4095  # of 12 bits


def sample_range(picture: Decoded, stem: str) -> Range | None:
    """Black and white level of a picture of this data set, told by its file name and by samples that 12 bits hold; else None."""
    if picture.pixels.dtype != np.uint16 or picture.pixels.shape[2] != 3 or picture.pixels.max() > _WHITE:
        return None
    for name, black, camera in _CAMERAS:
        if name.fullmatch(stem):
            return Range(black, _WHITE, f"taken for Gehler's data set as Shi and Funt publish it: {camera}, black level {black}")
    return None
