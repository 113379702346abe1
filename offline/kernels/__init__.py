"""The only package that uses Numba: arrays and scalars in, arrays out. No settings, no patterns, no calibration.

Results are identical for any number of threads: pieces that run in parallel write to separate memory, and the order of every sum
depends on the picture alone.
"""

import importlib
import sys

# Numba asks whether there is a BLAS, and so loads SciPy's linear algebra: half of what loading a kernel takes. No kernel needs it.
_BLAS = "scipy.linalg.cython_blas"
if _BLAS not in sys.modules:
    sys.modules[_BLAS] = None  # type: ignore[assignment]  # importing it fails at once
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        del sys.modules[_BLAS]
