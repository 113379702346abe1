"""
Five channels
=============

Photograph and render a scene of five bands: no stage knows what red, green and blue are.
"""

import matplotlib.pyplot as plt
import numpy as np

import panchroma

# %%
# A scene of five bands, as a spectrometer's: red, green and blue of the built-in scene, two mixed.
light = panchroma.simulate("builtin:480x320").truth.rgb
red, green, blue = np.moveaxis(light, 2, 0)
bands = np.stack([blue, (blue + green) / 2, green, (green + red) / 2, red], axis=2)

# %%
# A letter for each filter. A tile of 6 x 6 pixels has one block of six sites.
tile = "VRGWWW/NUGWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW"
shot = panchroma.simulate(bands, pattern=tile, bands="VNGUR", sigma=0.01)
picture = panchroma.render(shot)
print(shot, picture, panchroma.compare(picture, shot.truth), sep="\n")

# %%
# Each channel, without colour: what a band looks like is not known.
_, axes = plt.subplots(1, 5, figsize=(12, 2), layout="constrained")
for axis, channel, name in zip(axes, np.moveaxis(picture.rgb, 2, 0), picture.channels, strict=True):
    axis.imshow(channel, cmap="gray", vmin=0, vmax=1)
    axis.set(title=name, xticks=[], yticks=[])
