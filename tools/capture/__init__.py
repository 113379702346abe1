"""A running camera: the sources of its frames, and the viewfinder."""
