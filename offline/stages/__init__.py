"""The stages of a render: one file for each, with its equation, its settings, its NumPy and its
kernels.
"""
