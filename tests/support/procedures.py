"""The example's welding procedure specification for runs whose cloud is not at hand."""

from __future__ import annotations

from pathlib import Path

EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "wps.toml"
WPS_TEXT = EXAMPLE.read_text(encoding="utf-8").split("[[detail]]")[0]
"""Without a table of details, for which the tubes are fitted to the cloud."""


def wps_beside(run: Path) -> Path:
    """Write it beside a run directory."""
    file = run.parent / "wps-without-details.toml"
    file.write_text(WPS_TEXT, encoding="utf-8")
    return file
