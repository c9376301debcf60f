"""A tow along a seam: run, replayed, and what it leaves behind."""
