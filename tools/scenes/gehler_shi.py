"""Gehler's colour-checker photographs as L. Shi and B. Funt publish them: 16-bit PNG that hold 12-bit camera samples.

Each pixel is already a 2 x 2 quad of the Bayer sensor. The samples are as the camera wrote them: the black level is 129 for the
Canon 5D (files IMG_NNNN) and 0 for the Canon 1D (files 8D5UNNNN). The paper's ten scenes are from this set.
"""

import re

import numpy as np

from shared.white_balance import shades_of_grey

from .clipped import with_white_highlights
from .decoders import Decoded
from .scene import Scene

_CAMERAS = ((re.compile(r"IMG_\d{4}"), 129, "Canon 5D"), (re.compile(r"8D5U\d{4}"), 0, "Canon 1D"))
_WHITE = 4095  # 12 bits


def gehler_shi_scene(picture: Decoded, stem: str) -> Scene | None:
    """Return the scene in a picture of this data set, or None for any other: file name and 12-bit samples identify it.

    rgb is (code - black) / (white - black); values below black, which noise causes, become 0.
    """
    if picture.pixels.dtype != np.uint16 or picture.pixels.shape[2] != 3 or picture.pixels.max() > _WHITE:
        return None
    for name, black, camera in _CAMERAS:
        if name.fullmatch(stem):
            light = np.maximum((picture.pixels.astype(np.float32) - black) / np.float32(_WHITE - black), 0)
            note = f"recognised as Gehler's data set in Shi and Funt's version: {camera}, black level {black}"
            neutral = shades_of_grey(light)
            light, clipped = with_white_highlights(light, neutral)
            return Scene(light, stem, None, neutral, picture.metadata, (*picture.notes, note, *clipped))
    return None
