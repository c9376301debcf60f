"""URScript as the loopback controller runs it: parsed, compiled, run tick by tick."""
