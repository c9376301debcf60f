"""The calibration as an operator goes through it, with arm and laser."""
