"""Jobs of short simulated crawls."""

from _crawls import SHORT_CRAWL

SHORT = (
    SHORT_CRAWL
    + """
[[pass]]
speed_mm_s = 20
weave_mm = 2
weave_period_s = 1
procedure = "WPS-2"
[[simulation.joint.beads]]
level_mm = 6
"""
)
"""A job of two short passes."""
