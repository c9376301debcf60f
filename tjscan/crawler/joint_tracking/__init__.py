"""The centre of a butt joint, tracked from profile to profile."""
