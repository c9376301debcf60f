"""Weld plans: read a run, plan its beads, write their files, prove and send their programs."""
