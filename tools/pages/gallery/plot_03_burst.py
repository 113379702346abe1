"""
A burst becomes one picture
===========================

A hand trembles, so that another frame sees the colour that one frame misses.
"""

import matplotlib.pyplot as plt
import numpy as np

import panchroma
from panchroma.offline import render
from panchroma.offline.burst import merge_burst, render_burst_bands
from panchroma.tools.simulation.simulated_camera import SimulatedBurst, burst_frames

# %%
# Six frames of the built-in scene, displaced by up to three pixels:
scene = panchroma.simulate("builtin:440x320").truth.rgb
rng = np.random.default_rng(0)
frames = list(burst_frames(scene, SimulatedBurst(6, pixels=3), rng))
shots = [
    panchroma.simulate(frame.rgb.clip(0, 1), sigma=0.01, rng=number)
    for number, frame in enumerate(frames)
]

# %%
# Frames are aligned with the reference and merged where they agree with it.
mosaics = [shot.mosaic for shot in shots]
merged = merge_burst(mosaics, reference=0)
burst, single = np.concatenate(list(render_burst_bands(merged))), render(mosaics[0]).rgb
for name, picture in (("one frame", single), ("six frames", burst)):
    print(f"{name:10}", panchroma.compare(picture, frames[0].rgb))

# %%
_, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
pictures = {"truth": frames[0].rgb, "one frame": single, "six frames": burst}
for axis, (name, picture) in zip(axes, pictures.items(), strict=True):
    axis.imshow(panchroma.to_srgb(picture).pixels[:160, :200])
    axis.set(title=name, xticks=[], yticks=[])
