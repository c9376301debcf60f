"""What the program does, one file a verb: each takes a job file to a run directory."""
