"""What is compiled ahead is what renders call: no kernel less, and none more that takes long."""

import pytest

from tests.python import run_python

SCRIPT = """
import sys
import numpy as np
from panchroma import offline
from panchroma.offline.ahead import used_kernels
from panchroma.offline.numerics.compile import kernels
from panchroma.shared import CfaPattern, SensorCalibration
from panchroma.tools.simulation.sensor import simulate_additive

scene = np.full((90, 120, 3), 0.3, np.float32)
scene[20:50, 30:70] = 2  # clipped
scene[:, 80:] = 0.5, 0.2, 0.1  # blocks that no line explains
mosaic = simulate_additive(scene, CfaPattern.bayer(6), SensorCalibration.of_bits(12), 0.01, np.random.default_rng(0))
samples = np.clip(mosaic.samples / 3 * 4095, 0, 4095).astype(np.uint16)
samples[70, 100] = 4095  # defective
settings = getattr(offline, sys.argv[1])
tiny = np.full((24, 24, 3), 0.2, np.float32)
tiny[:, 12:] = 0.5, 0.1, 0.05  # on no line
tiny = simulate_additive(tiny, CfaPattern.bayer(6), SensorCalibration(), 0.01, np.random.default_rng(0))
offline.render(tiny, settings)
shared = {"interpolate", "smooth"}  # by stages; quickly compiled
print({name for name in kernels if kernels[name].ready} ^ set(used_kernels(settings)) <= shared)
offline.render(type(mosaic)(samples, mosaic.pattern, mosaic.calibration), settings)
called = {name for name in kernels if kernels[name].ready}
print(called - set(used_kernels(settings)), set(used_kernels(settings)) - called <= shared)
print(offline.kernels_to_compile(settings), set(used_kernels()) ^ set(kernels))
"""


@pytest.mark.parametrize("preset", ["PAPER", "BEST"])
def test_a_render_calls_the_kernels_that_it_is_said_to(preset: str) -> None:
    assert run_python(SCRIPT, preset) == "True\nset() True\n[] set()\n"
