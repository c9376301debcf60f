"""What a line laser is, and the one that is simulated."""
