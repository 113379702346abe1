"""
A burst becomes one picture
===========================

A hand trembles, so that another frame sees the colour that one frame misses.
"""

import matplotlib.pyplot as plt

import panchroma

# %%
# Six frames of the built-in scene, displaced by up to three pixels. The first is the reference, and
# has not moved.
shots = panchroma.simulate("builtin:440x320", burst=6, motion=3, sigma=0.01)

# %%
# Frames are aligned with the reference and merged where they agree with it.
pictures = {
    "one frame": panchroma.render(shots[0]),
    "six frames": panchroma.burst(shots, reference=0),
}
for name, picture in pictures.items():
    print(f"{name:10}", panchroma.compare(picture, shots[0].truth))

# %%
# What became of each frame: its displacement (right, down) in pixels, and its angle.
for frame in pictures["six frames"].facts["frames"]:
    print("{source}: {right:5.2f} {down:5.2f} {degrees:6.3f}".format(**frame))

# %%
_, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
shown = {"truth": shots[0].truth, **pictures}
for axis, (name, picture) in zip(axes, shown.items(), strict=True):
    axis.imshow(panchroma.to_srgb(picture).pixels[:160, :200])
    axis.set(title=name, xticks=[], yticks=[])
