"""The simulated camera: from the light of a scene to a shot, and to the truth that pictures of it are compared with."""
