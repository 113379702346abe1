"""Calibrate a camera from its shots: gamma (Eq. 7), noise, black level, defects and colour;
camera.json and the report.
"""
