"""The example's cell, as tests need it: with or without faults, with any key replaced."""

from __future__ import annotations

from collections.abc import Callable, Container
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from tjscan.calibration.file import CalibrationFile, write_calibration
from tjscan.calibration.noise import NoiseModel
from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core.config import validate_table
from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array, JointOrBaseFrame, transform_points
from tjscan.core.provenance import Provenance
from tjscan.groove.prior import GroovePrior
from tjscan.groove.read import read_groove
from tjscan.groove.section import GrooveSection
from tjscan.job.files import read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.profile import Profile
from tjscan.recording.journal import RunEvent
from tjscan.runs.scan.run import ScanContext
from tjscan.scanning.journal import ScanResult
from tjscan.scanning.profile_taker import ScanSetup
from tjscan.scanning.scanner import Scanner
from tjscan.scanning.section import ProfileView, ScannedSection, SetPointPredictor
from tjscan.scanning.sections_before import GrooveReader
from tjscan.scanning.stopping import StopRequest

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
PAPER, CLOCKWISE = EXAMPLES / "paper.toml", EXAMPLES / "paper-clockwise.toml"

FAULTLESS: dict[str, Any] = {
    **dict.fromkeys(
        [
            f"simulation.laser.{name}"
            for name in (
                "noise_mm",
                "bias_mm",
                "dropout",
                "missing",
                "ghosts",
                "flyers",
                "resolution_mm",
            )
        ],
        0,
    ),
    "simulation.arm.repeatability_mm": 0,
    "simulation.arm.repeatability_deg": 0,
}
"""Every fault of the simulated laser and arm switched off."""


class Notes:
    """A journal that keeps what it is told."""

    def __init__(self) -> None:
        self.views: list[ProfileView] = []
        self.sections: list[ScannedSection] = []
        self.events: list[tuple[str, str]] = []

    def record(self, message: object) -> None:
        match message:
            case ProfileView():
                self.views.append(message)
            case ScannedSection():
                self.sections.append(message)
            case RunEvent(name, detail):
                self.events.append((name, detail))


def scan_example(
    overrides: dict[str, Any],
    *,
    file: Path = PAPER,
    notes: Notes | None = None,
    read: GrooveReader = read_groove,
    through: Callable[[LineLaser], LineLaser] = lambda laser: laser,
    predictor: SetPointPredictor | None = None,
    stop: StopRequest | None = None,
) -> ScanResult:
    """Scan an example with keys replaced, its laser heard `through` another one."""
    job = read_scan_job(file, overrides)
    with ScanContext(job, file).make_cell() as cell:
        scanner = Scanner(
            ScanSetup(cell.arm, through(cell.laser), cell.T_f_s, read),
            job.scan,
            notes or Notes(),
            predictor,
            stop=stop,
        )
        first, second = job.start_poses
        return scanner.run(first.T, second.T)


def example_corner_errors(result: ScanResult, file: Path = PAPER) -> Array:
    """Distances of p2, p3, p4 from the example's edges, metres, shape (n, 3)."""
    job = read_scan_job(file)
    joint = ScanContext(job, file).joint
    assert joint is not None
    assert job.joint is not None
    T_j_b = JointOrBaseFrame(job.joint.T_w_j).T_r_b
    corners = np.array([transform_points(T_j_b, scan.points_b) for scan in result.sections])
    return corner_to_edge_distances(corners, feature_edges(joint))


def calibration_file(file: Path) -> Path:
    """A calibration of the example's arm and laser that says what its job says, in a file."""
    variance = 0.01
    found = validate_table(
        CalibrationFile,
        {
            "arm": "ur10e",
            "laser": "simulated",
            "date": datetime(2026, 3, 4, tzinfo=UTC),
            "method": "plane touched",
            "lines": 12,
            "T_f_s_mm": read_scan_job(PAPER).calibration.T_f_s_mm,
            "covariance": np.diag(np.full(6, variance)).tolist(),
            "sigma_position_mm": float(np.sqrt(3 * variance)),
            "sigma_rotation_deg": float(np.sqrt(3 * variance)),
            "condition": 1.0,
            "excess": 1.0,
            "noise": NoiseModel(),
            "residuals": [],
        },
    )
    write_calibration(file, found, Provenance.for_file_written_now("calibrate.toml", "f"))
    return file


def reading_fails_at(calls: Container[int]) -> GrooveReader:
    """A reader that finds no groove in the profiles of these numbers."""
    count = iter(range(10_000))

    def read(profile: Profile, *, prior: GroovePrior | None = None) -> GrooveSection:
        if next(count) in calls:
            raise GrooveNotFound("no bevel", "hidden by a clamp")
        return read_groove(profile, prior=prior)

    return read
