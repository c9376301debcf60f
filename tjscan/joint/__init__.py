"""The tubular joint: its intersection curve, its bevel and its solid."""
