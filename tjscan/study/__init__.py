"""Many simulated scans: a grid of jobs, run in parallel, told in one table."""
