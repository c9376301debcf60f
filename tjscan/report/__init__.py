"""A run for people: one file that tells what was scanned, how well, and what to know of it."""
