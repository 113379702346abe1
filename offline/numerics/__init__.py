"""The only package that uses Numba: arrays and scalars in, arrays out. No settings, no patterns, no
calibration.

Results are identical for any number of threads: pieces that run in parallel write to separate
memory, and the order of every sum depends on the picture alone.
"""
