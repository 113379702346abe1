"""
Read a camera's stream
======================

Unpack raw frames as a camera driver delivers them, and save each as a DNG with its preview.
"""

import io
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt

import panchroma
from panchroma.device import Preview
from panchroma.device.capture import FrameLayout, Sensor, ShotFolder, capture, read_frames

# %%
# A stream of three frames of 16 bits in a file; a camera's is standard input, and often packed
# (``raw12``). Size and stride are what the driver prints.
shot = panchroma.simulate("builtin:480x320", light=1)
stream = io.BytesIO(shot.mosaic.codes.astype("<u2").tobytes() * 3)
layout = FrameLayout(480, 320, "u16")

# %%
# The sensor says which filters and which levels the samples have.
sensor = Sensor(layout, shot.pattern, shot.calibration)
preview = Preview.for_mosaic(sensor.dark())
folder = Path(mkdtemp())
outcomes = list(capture(read_frames(stream, layout), sensor, preview.run, ShotFolder(folder)))
print(*[type(outcome).__name__ for outcome in outcomes])

# %%
# Each file is a shot, ready for the render.
saved = panchroma.open(outcomes[0].path)
plt.imshow(panchroma.preview(saved))
plt.gca().set_axis_off()
