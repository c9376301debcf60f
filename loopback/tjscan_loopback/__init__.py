"""Loopback devices for the real drivers of tjscan: a controller, a laser, vehicles."""
