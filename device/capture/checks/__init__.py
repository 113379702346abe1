"""Comparison of raw frames with the description of their sensor."""
