"""
Add a rival
===========

Compare a method of your own for a Bayer camera with Panchroma, in front of the same scene.
"""

import matplotlib.pyplot as plt
from scipy.ndimage import gaussian_filter

import panchroma
from panchroma.shared import CfaPattern
from panchroma.tools.evaluation.cameras import CameraPair, Method
from panchroma.tools.evaluation.methods import methods
from panchroma.tools.evaluation.rivals.bilinear import demosaic_bilinear
from panchroma.tools.simulation.protocols import PaperProtocol


# %%
# A rival takes the shot of a Bayer camera and what white reads, and returns (H, W, 3).
def smooth(shot, white):
    return gaussian_filter(demosaic_bilinear(shot.samples), (0.7, 0.7, 0))


# %%
# Both cameras photograph the same light with the same noise. ``panchroma evaluate`` has your rival
# once it is a file in ``tools/evaluation/rivals``.
truth = panchroma.simulate("builtin:480x320").truth.rgb
cameras = CameraPair(PaperProtocol(0.03), 0, truth, CfaPattern.bayer(6), None)
rivals = [Method("smooth", "Bayer, smooth", smooth), methods()["dlmmse"], methods()["best"]]
_, axes = plt.subplots(1, 3, figsize=(12, 3.2), layout="constrained")
for axis, method in zip(axes, rivals, strict=True):
    picture = method.render(cameras)
    print(f"{method.name:8}", panchroma.compare(picture, truth))
    axis.imshow(panchroma.to_srgb(picture).pixels[:120, :160])
    axis.set(title=method.title, xticks=[], yticks=[])
