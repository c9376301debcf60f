"""Studies of tows: what they vary, make and measure."""
