"""Line lasers: the protocol, the simulated one, recorded ones, and profiles from files."""
