"""The simulated camera: drawn scenes, filters, noise, motion; from the light of a scene to a
shot.
"""
