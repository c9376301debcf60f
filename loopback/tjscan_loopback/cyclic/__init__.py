"""Controllers that ask for joint angles in every cycle: what all of them share."""
