"""
Calibrate from a chart
======================

Measure gamma, the weights of the channels in a panchromatic pixel, from one shot of a ColorChecker.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from panchroma.shared import CfaPattern, SensorCalibration
from panchroma.tools.calibration.measure import measure_chart
from panchroma.tools.simulation.drawn.charts import chart_scene, color_checker_xyz
from panchroma.tools.simulation.sensor import simulate_sensor

# %%
# A sensor of gamma (0.9, 1.1, 0.8) photographs the chart, and its file does not know gamma yet.
pattern, rng = CfaPattern.bayer(6), np.random.default_rng(0)
sensor = SensorCalibration.of_bits(12, gamma=(0.9, 1.1, 0.8), headroom=False)
shot = simulate_sensor(chart_scene(480, 320).rgb, pattern, sensor, 1.0, rng)
unknown = replace(shot, calibration=replace(sensor, gamma=(1.0, 1.0, 1.0)))

# %%
# The chart is found, and gamma follows from all its patches: Eq. 7 in each. Gamma and the half
# width of its 95 % interval:
found = measure_chart("chart.dng", unknown, color_checker_xyz())
print(np.round(found.fit.gamma, 3), np.round(found.fit.half_width, 3))

# %%
# The patches that were measured. On files, ``panchroma calibrate chart.dng -o camera.json --report
# report`` does this, and measures noise, black level, defects, shading and colour as well.
plt.figure(figsize=(6, 4), layout="constrained")
plt.imshow(found.picture)
plt.gca().set_axis_off()
