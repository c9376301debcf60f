"""From what was seen to the sensor's pose: in closed form, then as the likeliest."""
