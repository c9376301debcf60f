"""Scanning without stopping: the groove is followed in one motion and measured on the way."""
