"""Weld, look, weld on: the run of `tjscan weld`."""
