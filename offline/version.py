"""Which algorithm renders: what tells an archive whether its pictures are still those that it would get now."""

ALGORITHM = 1
"""Goes up by one whenever the same mosaic, with the same settings, gives another picture than before: with any change of results,
however small, in `offline/` and in how a picture is coloured. Batches make pictures of another number anew. A change that is
invisible to the last bit leaves it; `tests/golden/` holds what this number stands for, and fails when either moves alone.
"""
