"""The calibration report: one page for the engineer who signs."""
