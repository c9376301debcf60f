"""Profiles from files of other makes."""
