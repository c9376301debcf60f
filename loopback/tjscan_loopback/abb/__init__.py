"""A loopback ABB controller with Externally Guided Motion (EGM)."""
