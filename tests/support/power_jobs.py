"""A job's table of a power source's registers, made up, for tests."""

from pathlib import Path
from typing import Any, Final

from tjscan.core.config import validate_table
from tjscan.power.modbus.registers import ModbusPowerSettings

REGISTERS: Final = (
    {"name": "start", "word": 100, "bit": 0},
    {"name": "robot_ready", "word": 100, "bit": 1},
    {"name": "error_reset", "word": 100, "bit": 2},
    {"name": "gas", "word": 100, "bit": 3},
    {"name": "feed", "word": 102, "scale": 0.01, "range": [1.0, 25.0]},
    {"name": "correction", "word": 103, "scale": 0.1, "signed": True},
    {"name": "ready", "word": 200, "bit": 1},
    {"name": "stable", "word": 200, "bit": 2},
    {"name": "flow", "word": 200, "bit": 3},
    {"name": "wire_stuck", "word": 200, "bit": 14, "inverted": True},
    {"name": "error", "word": 201},
    {"name": "voltage", "word": 202, "scale": 0.01, "range": [0.0, 100.0]},
    {"name": "current", "word": 203, "scale": 0.1, "range": [0.0, 500.0]},
    {"name": "measured_feed", "word": 204, "scale": 0.01},
    {"name": "gas_flow", "word": 205, "scale": 0.1},
)


def modbus_table(**changed: Any) -> dict[str, Any]:
    table: dict[str, Any] = {
        "port": 5020,
        "write": [100, 8],
        "read": [200, 8],
        "register": [dict(one) for one in REGISTERS],
        "constant": [{"word": 101, "value": 9}],
    }
    return table | changed


def modbus_settings(**changed: Any) -> ModbusPowerSettings:
    return validate_table(ModbusPowerSettings, modbus_table(**changed))


def write_power_job(file: Path) -> Path:
    import tomli_w

    file.write_text(tomli_w.dumps({"power": {"driver": "modbus", "modbus": modbus_table()}}))
    return file
