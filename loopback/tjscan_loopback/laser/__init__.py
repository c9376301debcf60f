"""A line laser that speaks GigE Vision on this machine, for real client libraries to talk to."""
