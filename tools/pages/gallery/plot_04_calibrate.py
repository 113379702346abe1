"""
Calibrate from a chart
======================

Measure gamma, the weights of the channels in a panchromatic pixel, and noise, black level and
colours, from a ColorChecker, dark and flat frames.
"""

import json
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt

import panchroma

# %%
# A sensor to be measured: its panchromatic pixels see less red and blue than green. What the shots
# state of it is not used.
folder = Path(mkdtemp())
sensor = {"schema": 1, "gamma": [0.9, 1.1, 0.8], "black_level": [97] * 4, "white_level": 4095}
(folder / "sensor.json").write_text(json.dumps(sensor))


def shots(scene, light):
    """Take two frames of a scene."""
    settings = {"light": light, "camera": folder / "sensor.json"}
    return [panchroma.simulate(f"{scene}:480x320", rng=seed, **settings) for seed in (1, 2)]


# %%
# The chart, the lens covered, and an even surface in three lights:
chart = shots("chart", 1)[0]
flats = [flat for light in (0.1, 0.3, 0.6) for flat in shots("flat", light)]
found = panchroma.calibrate(chart, dark=shots("dark", 1), flat=flats)
found

# %%
# Gamma, and the half width of its 95 % interval; black levels; how far colours are off:
print(found.camera.calibration.gamma, found.facts["gamma"]["half_width_95"])
print(found.camera.calibration.black_level)
print(found.facts["colour"])

# %%
# Files have the result as camera.json, which ``open`` and the commands take:
found.save(folder / "camera.json")
chart.save(folder / "chart.dng")
calibrated = panchroma.open(folder / "chart.dng", camera=folder / "camera.json")
plt.imshow(panchroma.to_srgb(panchroma.render(calibrated)))
plt.gca().set_axis_off()
