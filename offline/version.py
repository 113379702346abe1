"""The version of the algorithm, by which an archive knows whether rendering again would change its
pictures.
"""

ALGORITHM = 56
"""Increase it by one whenever the same mosaic with the same settings gives a different picture:
with any change of results, however small, in `offline/` or in how a picture is coloured. `render
--resume` then renders the pictures of older versions again. A change that keeps every bit keeps the
number. `tests/golden/` holds the pictures of this number, and fails when either changes alone.
"""
