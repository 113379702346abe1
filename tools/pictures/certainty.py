"""A map of where a picture's colour is measured, inferred, or guessed."""

import numpy as np

from shared.arrays import ByteArray, FloatArray

INFERRED, GUESSED = 0.02, 0.06
"""How far colour may be off, a share of the light, from which on it is inferred from the blocks around, and from which on it is a
guess: there a wrong hue is seen at a glance (a difference of some 10 CIEDE2000 in a grey of medium brightness is 0.06 to 0.1)."""
LEGEND = "grey: colour is measured; blue: inferred; orange: guessed"
_DARK = 0.01  # of full scale: light that is as good as none
_TINTS = np.array(((255, 255, 255), (92, 160, 255), (255, 140, 30)), np.float32) / 255


def colour_doubt(luminance: FloatArray, uncertainty: FloatArray, gamma: FloatArray) -> FloatArray:
    """How far colour may be off, as a share of the light, float32 (H, W).

    luminance: (H, W), what a panchromatic pixel reads. uncertainty: see `offline.Rendering`. gamma: (C,), of Eq. 7.
    """
    off = np.sqrt(np.square(uncertainty[..., 1:] * gamma).sum(axis=2))
    return off / (np.maximum(luminance, 0) + np.float32(_DARK) * gamma.sum())


def certainty_map(shown: ByteArray, doubt: FloatArray) -> ByteArray:
    """The picture, uint8 (H, W, 3), in grey, tinted where its colour is inferred or guessed. doubt: (H, W), see `colour_doubt`."""
    grey = 60 + shown.mean(axis=2, dtype=np.float32) * np.float32(195 / 255)
    return np.rint(grey[..., None] * _TINTS[np.digitize(doubt, (INFERRED, GUESSED))]).astype(np.uint8)
