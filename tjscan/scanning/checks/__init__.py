"""What is refused: set-points, profiles and sections that cannot be meant."""
