"""From a profile to the five points of the groove, and to its section."""
