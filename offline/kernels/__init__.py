"""The only home of Numba: arrays and scalars in, arrays out. No settings, no patterns, no calibration.

Every result is the same bytes for any number of threads: a piece of work that runs beside others writes what no other touches, and
sums run in an order that only the picture decides.
"""
