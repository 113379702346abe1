"""Broadband filters at the colour sites: cyan, magenta and yellow collect twice the light of red, green and blue."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from offline import BEST, PRESETS
from shared.arrays import FloatArray
from tools.camera.protocols import Protocol
from tools.evaluation.hue import wrong_hue
from tools.evaluation.metrics import BORDER, psnr, quality
from tools.evaluation.ours import render_preset
from tools.scenes.scene import Scene

from .cameras import rendered

MEASURES = "median RGB", "luminance", "chrominance", "10 % chrominance", "whole image", "wrong hue, %"
BLOCKS = "RG/GB", "RG/BW", "CM/YC", "MY/CM", "CY/YM", "CM/YW"
_INNER = np.s_[BORDER:-BORDER, BORDER:-BORDER]


def broadband(scene: Scene, level: Protocol) -> Iterator[tuple[str, list[float]]]:
    """Name and MEASURES of each block, K = 6, all in the scene's RGB."""
    for block in BLOCKS:
        presets = {f"`{block}`": PRESETS["unlearned"]}
        if block == "RG/GB":  # there is a network for no other of these
            presets[f"`{block}`, network"] = BEST
        for name, settings in presets.items():
            yield name, measured(rendered(block, 6, scene, level, partial(render_preset, settings)), scene.rgb)


def measured(picture: FloatArray, truth: FloatArray) -> list[float]:
    """The MEASURES of a picture, (H, W, 3)."""
    found = quality(picture, truth)
    hue = 100 * float(wrong_hue(picture[_INNER], truth[_INNER]).mean())
    return [*found.median, found.chrominance[0], psnr(picture, truth, BORDER), hue]
