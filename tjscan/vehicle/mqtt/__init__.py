"""Vehicles, a torch and localisation behind an MQTT broker."""
