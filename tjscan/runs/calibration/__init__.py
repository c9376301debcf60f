"""A calibration, from its job to its run directory, its page and its report."""
