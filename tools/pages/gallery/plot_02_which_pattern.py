"""
Which filter pattern?
=====================

Photograph one scene through several patterns, under the same noise, and compare the pictures.
"""

import matplotlib.pyplot as plt

import panchroma

# %%
# A number is the period K of the paper's Bayer block; letters are a tile, row by row, W is
# panchromatic; some tiles have names.
patterns = {"K = 6": 6, "K = 4": 4, "three sites": "RGWW/BWWW/WWWW/WWWW", "Kodak": "kodak"}
shots = {
    name: panchroma.simulate("builtin:480x320", pattern=pattern, sigma=0.01)
    for name, pattern in patterns.items()
}
pictures = {name: panchroma.render(shot) for name, shot in shots.items()}

# %%
# Median PSNR of small patches, and wrong hues. Real photographs decide: see
# :doc:`which pattern </tools/evaluation/RESULTS>`.
for name, picture in pictures.items():
    print(f"{name:12}", panchroma.compare(picture, shots[name].truth))

# %%
# Fine colour is where patterns differ:
_, axes = plt.subplots(1, 5, figsize=(12, 2.8), layout="constrained")
shown = {"truth": shots["K = 6"].truth, **pictures}
for axis, (name, picture) in zip(axes, shown.items(), strict=True):
    axis.imshow(panchroma.to_srgb(picture).pixels[20:110, 20:110])
    axis.set(title=name, xticks=[], yticks=[])
