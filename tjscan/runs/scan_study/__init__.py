"""Studies of scans: what they vary, make and measure."""
