"""Names of the files in a run directory."""

from __future__ import annotations

from typing import Final

JOB: Final = "job.toml"
JOINT: Final = "joint.toml"
CALIBRATION: Final = "calibration.toml"
URDF: Final = "arm.urdf"
SECTIONS: Final = "sections.csv"
CLOUD: Final = "groove.ply"
SUMMARY: Final = "summary.json"
PICTURE: Final = "scan.png"
STATIONS: Final = "stations.json"
STATIONS_PICTURE: Final = "stitch.png"
