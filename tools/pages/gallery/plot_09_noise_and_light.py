"""
Noise and light
===============

See what becomes of a picture when light falls, and what the noise model is worth.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import panchroma

# %%
# ``light`` is the noise of a sensor: shot and read noise, clipping, 12 bits. 1 is a full exposure,
# and each quarter two stops less.
lights = 1, 1 / 4, 1 / 16, 1 / 64
shots = [panchroma.simulate("builtin:480x320", light=light) for light in lights]
pictures = [panchroma.render(shot) for shot in shots]
_, axes = plt.subplots(1, 4, figsize=(12, 2.6), layout="constrained")
for axis, light, shot, picture in zip(axes, lights, shots, pictures, strict=True):
    print(f"light {light:.3f}", panchroma.compare(picture, shot.truth))
    axis.imshow(panchroma.to_srgb(picture, exposure=-np.log2(light)).pixels[:120, :160])
    axis.set(title=f"light {light:g}", xticks=[], yticks=[])

# %%
# Variance is shot * signal + read ** 2. A calibration knows both; without them the render estimates
# the noise from the samples:
mosaic = shots[2].mosaic
unknown = replace(mosaic, calibration=replace(mosaic.calibration, noise=None))
print(mosaic.calibration.noise)
print(panchroma.compare(panchroma.render(panchroma.Shot(unknown)), shots[2].truth))
