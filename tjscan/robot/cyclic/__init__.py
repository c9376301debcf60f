"""What arms share whose controllers ask for joint angles in every cycle, over UDP."""
