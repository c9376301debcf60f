"""The acceptance of a cell: what it measures of a known artefact, against what its job states."""
