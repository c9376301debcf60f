"""Hand-eye calibration: where the laser sits on the flange."""
