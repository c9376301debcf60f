"""Tracks, gantries and turn-tables that carry an arm or a joint: kinematics and drivers."""
