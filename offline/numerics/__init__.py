"""The only package that uses Numba: arrays and scalars in, arrays out. No settings, no patterns, no
calibration.

Results are identical for any number of threads: pieces that run in parallel write to separate
memory, and the order of every sum depends on the picture alone.
"""

from ...shared.errors import InputError

try:
    import numba
except PermissionError as error:  # it tries whether machine code may be made
    raise InputError(
        "the render needs machine code, which this system forbids to make; allow it: "
        "MemoryDenyWriteExecute=no in systemd, execmem in SELinux"
    ) from error
if numba.config.DISABLE_JIT:
    raise InputError(
        "the render needs machine code, and Numba is told to make none; unset NUMBA_DISABLE_JIT"
    )
