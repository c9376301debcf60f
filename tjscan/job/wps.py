"""Read a welding procedure specification from its file."""

from __future__ import annotations

from pathlib import Path

from tjscan.core.config import read_toml, validate_table
from tjscan.planning.wps import WeldingProcedure


def read_wps(file: Path) -> WeldingProcedure:
    """Read a WPS file.

    Parameters
    ----------
    file : Path
        TOML; `docs/planning.md` lists its keys.

    Raises
    ------
    ConfigurationError
        If it can't be read, or for the first key that is unknown, missing or wrong.
    """
    return validate_table(WeldingProcedure, read_toml(file), file)
