"""A FANUC arm over Stream Motion."""
