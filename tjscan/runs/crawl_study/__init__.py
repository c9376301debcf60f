"""Studies of crawls: what they vary, make and measure."""
