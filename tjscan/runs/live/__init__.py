"""What each task shows on the live page."""
