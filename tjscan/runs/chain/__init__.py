"""The whole chain of a simulated cell: calibrate, scan, stitch, compare; which error does what."""
