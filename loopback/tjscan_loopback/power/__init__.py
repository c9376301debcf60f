"""A power source behind Modbus TCP on this machine."""
