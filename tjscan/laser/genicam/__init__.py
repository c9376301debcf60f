"""Line lasers that speak GigE Vision with GenICam's features, and what has the same transport."""
