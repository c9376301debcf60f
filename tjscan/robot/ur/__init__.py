"""A Universal Robots arm over its network interfaces."""
