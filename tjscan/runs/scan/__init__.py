"""A scan from one station: run, read again, and what it leaves behind."""
