"""From measured sections of a groove to a multi-pass weld plan: pure functions of arrays."""
