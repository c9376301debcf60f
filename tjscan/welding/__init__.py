"""Welding: a bead's shape, what it shrinks, the simulated weld, and planning the next bead."""
