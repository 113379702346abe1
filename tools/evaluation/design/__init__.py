"""Which filter tile should a sensor have? A fast judge of tiles, a search, and a slow judge on photographs: `panchroma design`."""
