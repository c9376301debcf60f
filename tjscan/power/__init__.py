"""Power sources: protocol, simulation, Modbus, and the order of events of an arc."""
