"""
First shot and render
=====================

Simulate a shot, render it, and compare the picture with what the camera saw.
"""

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np

import panchroma

# %%
# A scene is a photograph (``"IMG_0001.CR2"``), an array, or the built-in one. Noise is Gaussian.
shot = panchroma.simulate("builtin:480x320", sigma=0.01)
shot

# %%
# The render is linear light at every pixel. The first one on a machine compiles for half a minute.
picture = panchroma.render(shot)
panchroma.compare(picture, shot.truth)

# %%
# The same shot by the published method:
panchroma.compare(panchroma.render(shot, preset="paper"), shot.truth)

# %%
# The camera's own preview, the render, and its error, three times as strong, on grey:
error = panchroma.to_srgb(np.clip(0.2 + 3 * (picture.rgb - shot.truth.rgb), 0, 1))
images = panchroma.preview(shot), panchroma.to_srgb(picture), error
_, axes = plt.subplots(1, 3, figsize=(12, 3), layout="constrained")
for axis, image, title in zip(axes, images, ("preview", "render", "error"), strict=True):
    axis.imshow(image)
    axis.set(title=title, xticks=[], yticks=[])

# %%
# Both have files: the shot is a DNG, as the camera saves it; a picture has the format of its name.
folder = Path(mkdtemp())
shot.save(folder / "leaves.dng")
picture.save(folder / "leaves.tif")
panchroma.open(folder / "leaves.dng")
