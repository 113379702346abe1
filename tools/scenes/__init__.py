"""Light in: camera RAWs, pictures and drawn scenes, as linear channels that a simulated sensor looks at."""
