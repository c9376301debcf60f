"""Where the laser sits on the hand."""
