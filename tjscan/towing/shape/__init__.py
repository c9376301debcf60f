"""The shape of a cable: estimated and planned, and the limits it keeps; numbers alone."""
