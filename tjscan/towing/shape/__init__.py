"""The shape of a cable: as it lies, as it is wanted, and the limits it keeps; numbers alone."""
