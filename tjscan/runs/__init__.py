"""What the program does, a room or a file a verb: each takes a job file to a run directory."""
