"""Power sources behind Modbus TCP, whose registers a job describes."""
