"""The simulated cable and the vehicles that hold it."""
