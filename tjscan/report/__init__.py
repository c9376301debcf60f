"""A run for people: one page that shows what was scanned, how well, and what went wrong."""
