"""Built-in scenes, which are drawn at any size."""
