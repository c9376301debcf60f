"""Hand-eye calibration: the pose of the laser on the flange."""
