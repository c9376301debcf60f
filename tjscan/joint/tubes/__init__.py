"""Tubes from points: cylinders fitted to walls, and the joint's frame that they make."""
