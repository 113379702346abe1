"""Built-in scenes, drawn at any size."""
