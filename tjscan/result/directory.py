"""The files in a run directory, and the job that they come from."""

from __future__ import annotations

from datetime import datetime
from hashlib import sha256
from pathlib import Path
from typing import Final

from tjscan.core.provenance import Provenance

JOB_FILE: Final = "job.toml"
JOINT_FILE: Final = "joint.toml"
CALIBRATION_FILE: Final = "calibration.toml"
URDF_FILE: Final = "arm.urdf"
RECORDING_FILE: Final = "scan.mcap"
SECTIONS_FILE: Final = "sections.csv"
SMOOTHED_FILE: Final = "smoothed.csv"
CLOUD_FILE: Final = "groove.ply"
SUMMARY_FILE: Final = "summary.json"
SCAN_PICTURE: Final = "scan.png"
CALIBRATION_PICTURE: Final = "calibration.png"
STATIONS_FILE: Final = "stations.json"
BUDGET_FILE: Final = "uncertainty.json"
STATIONS_PICTURE: Final = "stitch.png"


def job_label_of_run(*directories: Path) -> str:
    """Label of the job that a run's files come from, as their heads state it.

    Parameters
    ----------
    directories : Path
        A run directory, or several that were stitched: the first that holds a job counts.

    Returns
    -------
    str
        As the head of the ``job.toml`` states it. One of version 0.1.0 has no head: its own name,
        and the beginning of its SHA-256. Empty if there is none.
    """
    for directory in directories:
        if (file := directory / JOB_FILE).is_file():
            content = file.read_bytes()
            head = Provenance.from_comment_lines(content.decode(errors="replace"), "#")
            return job_label(JOB_FILE, content) if head is None else head.job
    return ""


def job_label(name: str, content: bytes) -> str:
    """Name of a job file, and the beginning of the SHA-256 of its content."""
    return f"{name}, SHA-256 {sha256(content).hexdigest()[:16]}"


def default_run_directory(job_file: Path, station: str | None = None) -> Path:
    """``runs/JOB-DATE``, or ``runs/JOB-STATION-DATE``, below the working directory."""
    words = (job_file.stem, *(() if station is None else (station,)))
    return Path("runs") / f"{'-'.join(words)}-{datetime.now():%Y%m%d-%H%M%S}"


def dated_sibling_directory(directory: Path) -> Path:
    """``RUN-DATE`` beside a run directory."""
    whole = directory.resolve()
    return whole.with_name(f"{whole.name}-{datetime.now():%Y%m%d-%H%M%S}")
