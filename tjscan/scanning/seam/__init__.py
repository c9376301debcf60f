"""The curve that finished sections lie on, carried on to the next one."""
