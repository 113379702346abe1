"""Stages of the render that go over the frame in rows, each on what the one before it has made of them."""
