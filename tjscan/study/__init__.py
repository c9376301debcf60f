"""Many simulated runs: a grid of jobs, run in parallel, in one table."""
