"""What a scan leaves behind for people and for the next program."""
