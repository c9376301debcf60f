"""The job of a tow: its tables, its checks, and the devices and the world that it describes."""
