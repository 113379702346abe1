"""A hand-held series of frames: how each moved against the reference."""
