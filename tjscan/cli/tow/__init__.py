"""The commands of ``tjscan tow``."""
