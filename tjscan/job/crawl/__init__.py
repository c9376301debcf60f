"""The job of a crawler: its tables, and the devices that it names."""
