"""Kernels compiled by Numba that several stages share, and what compiles them and distributes their
work: arrays and scalars in, arrays out. No settings, no patterns, no calibration.

Results are identical for any number of threads: chunks that run in parallel write to separate
memory, and the order of every sum depends on the picture alone.
"""

from ...shared.errors import InputError

try:
    import numba
except PermissionError as error:  # it tries whether machine code may be made
    fault = "the render needs machine code, which this system forbids to make"
    remedy = "MemoryDenyWriteExecute=no in systemd, execmem in SELinux"
    raise InputError(f"{fault}; allow it: {remedy}") from error
except ValueError as error:
    if "threads" not in str(error):
        raise
    raise InputError("NUMBA_NUM_THREADS is less than 1; set it to 1 or more, or unset it") from None
if not all(name.startswith(("+", "-")) for name in (numba.config.CPU_FEATURES or "+").split(",")):
    expected = "expected names with + or - such as +avx2,-fma; set it right, or unset it"
    # LLVM would end the process
    raise InputError(f"NUMBA_CPU_FEATURES is {numba.config.CPU_FEATURES}, {expected}")
if numba.config.DISABLE_JIT:
    raise InputError("the render needs machine code, but may not make it; unset NUMBA_DISABLE_JIT")
