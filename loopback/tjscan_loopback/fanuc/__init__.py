"""A loopback FANUC controller with Stream Motion."""
