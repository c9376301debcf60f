"""A Universal Robots controller on this machine, for the real client library to talk to."""
