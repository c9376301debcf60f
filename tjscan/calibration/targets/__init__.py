"""Calibration targets: what a profile shows of each, its residuals, and where solving begins."""
