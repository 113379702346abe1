"""The calibration report: one HTML page, for sign-off."""
