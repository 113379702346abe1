"""Scenes and pictures as files: decoders, encoders, colour and display."""
