"""The measured parts of a camera, one module each: what camera.json, the verdict and the report say of it. See `part.Part`."""
