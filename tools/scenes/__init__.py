"""Scenes for the simulated sensor: camera RAWs, pictures and drawn scenes, all as linear RGB."""
