"""Whether a calibration can be relied on; if not, why not."""
