"""Whether corners are as far off as their budget says: cells drawn with all that may err."""

from __future__ import annotations

import sys
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from _table import Row, main
from scipy.stats import chi2

from tjscan.core import pose_vector
from tjscan.core.frames import Array, JointOrBaseFrame, inverse_pose, unit_vector
from tjscan.core.units import pose_from_rows_mm, pose_to_rows_mm
from tjscan.groove.measured import MeasuredSection
from tjscan.job.files import read_scan_job
from tjscan.joint.edges import FeatureEdges, feature_edges
from tjscan.recording.journal import CombinedJournal
from tjscan.runs.scan.results import sections_in_result_frame
from tjscan.runs.scan.run import ScanContext, groove_reader_of_job, scan_in_cell
from tjscan.runs.scan.uncertainty import causes_of_job
from tjscan.stitching.stations import Station, station_from_recording
from tjscan.stitching.stitch import StitchedGroove
from tjscan.uncertainty.causes import budget_of_causes

EXAMPLE: Final = Path(__file__).resolve().parents[1] / "examples" / "whole-joint.toml"
DRAWS, QUICK_DRAWS = 20, 4
STEP_MM: Final = 60.0
SIGMA_MM, SIGMA_DEG = 0.1, 0.03
"""Of the calibration that each cell believes in, all directions together."""

LINEARITY_MM: Final = 0.1
HALF_TURN: Final = np.diag((-1.0, -1.0, 1.0, 1.0))
"""An upright joint looks the same from behind."""

COVERED: Final = chi2.ppf(0.95, 2)
STITCHED, PLACED, STATIONS = "stitched", "bases known", "stations"


@dataclass(frozen=True, slots=True)
class Squares:
    """Errors squared over what is stated, for each number, and the errors in mm."""

    squares: Array
    errors: Array


def across_edges(sections: tuple[MeasuredSection, ...], edges: FeatureEdges) -> Squares:
    """Corners against their designed edges, across these: a place along them is none of theirs."""
    squares, errors = [], []
    for corner, line in enumerate((edges.p2.points_j, edges.p3.points_j, edges.p4.points_j)):
        along = np.roll(line, -1, axis=0) - line
        lengths = np.sum(along**2, axis=1)
        for section in sections:
            p = section.points[corner + 1]
            t = np.clip(np.sum((p - line) * along, axis=1) / np.maximum(lengths, 1e-18), 0, 1)
            feet = line + t[:, None] * along
            nearest = int(np.argmin(np.sum((feet - p) ** 2, axis=1)))
            plane = np.linalg.svd(unit_vector(along[nearest])[None])[2][1:]
            off = plane @ (p - feet[nearest])
            stated = plane @ section.covariances[corner] @ plane.T
            squares.append(off @ np.linalg.solve(stated, off))
            errors.append(1e3 * np.linalg.norm(off))
    return Squares(np.array(squares), np.array(errors))


def draw(seed: int) -> dict[str, Squares]:
    """Draw a cell, scan with it from both stations, and stitch."""
    rng = np.random.default_rng([seed, 77])
    rows: Any = read_scan_job(EXAMPLE).simulation
    sigma = np.repeat((1e-3 * SIGMA_MM, np.radians(SIGMA_DEG)), 3) / np.sqrt(3)
    true = pose_from_rows_mm(rows.T_f_s_mm)
    believed = pose_to_rows_mm(pose_vector.boxplus(true, sigma * rng.standard_normal(6)))
    whole = read_scan_job(
        EXAMPLE,
        {
            "simulation.seed": 100 * seed,
            "simulation.arm.errors": {"seed": seed},
            "simulation.laser.linearity_mm": LINEARITY_MM,
            "scan.step_mm": STEP_MM,
            "calibration": {
                "T_f_s_mm": [list(row) for row in believed],
                "sigma_position_mm": SIGMA_MM,
                "sigma_rotation_deg": SIGMA_DEG,
            },
        },
    )
    joint = ScanContext(whole, EXAMPLE).joint
    if joint is None or whole.joint is None or whole.simulation is None:
        raise SystemExit(f"{EXAMPLE} names no joint to compare with")
    edges, stations, truth, placed = feature_edges(joint), [], [], []
    for name in whole.station_names:
        job = whole.job_at_station(name)
        station, T_j_b, sections = _station(name, job, inverse_pose(whole.joint.T_w_j))
        stations.append(station)
        truth.append(T_j_b)
        placed.append(across_edges(sections, edges))
    stitched = StitchedGroove(stations)
    return {
        PLACED: Squares(
            np.concatenate([one.squares for one in placed]),
            np.concatenate([one.errors for one in placed]),
        ),
        STITCHED: across_edges(stitched.sections, edges),
        STATIONS: placed_stations(stitched, truth),
    }


def placed_stations(stitched: StitchedGroove, truth: list[Array]) -> Squares:
    """Places of the stations against where they truly are, T_j_b of each."""
    poses = []
    for one, T in zip(stitched.stations, truth, strict=True):
        turns = (one.T_j_b @ inverse_pose(turn @ T) for turn in (np.eye(4), HALF_TURN))
        off = min((pose_vector.pose_to_vector(turn) for turn in turns), key=np.linalg.norm)
        poses.append(float(off @ np.linalg.solve(one.covariance, off)))
    return Squares(np.array(poses), np.zeros(0))


def _station(
    name: str, job: Any, T_j_w: Array
) -> tuple[Station, Array, tuple[MeasuredSection, ...]]:
    """A station as scanned, where its base truly stands, and its sections placed by that."""
    context = ScanContext(job, EXAMPLE)
    result = scan_in_cell(context.make_cell(), job, CombinedJournal())
    station = station_from_recording(
        name, job.T_w_b, result.sections, result.views, groove_reader_of_job(job)
    )
    causes = causes_of_job(job, context.sensor_mount, station.all_sections)
    T_j_b = T_j_w @ job.T_w_b_true
    budget = budget_of_causes(causes.causes, T_j_b, len(station.sections))
    sections = sections_in_result_frame(
        station.sections, JointOrBaseFrame(inverse_pose(T_j_b)), name
    )
    return replace(station, causes=causes.shared), T_j_b, budget.sections_with_covariances(sections)


def measure(draws: int = DRAWS) -> list[Row]:
    """Measure every limit over drawn cells."""
    found = defaultdict(list)
    for seed in range(1, draws + 1):
        for name, squares in draw(seed).items():
            found[name].append(squares)
    rows = []
    for name, dimension in ((PLACED, 2), (STITCHED, 2), (STATIONS, 6)):
        ratios = np.concatenate([one.squares for one in found[name]])
        rows.append(
            Row(f"{name}: error² / stated", float(ratios.mean()) / dimension, 1.5, at_least=0.7)
        )
        if dimension == 2:
            errors = np.concatenate([one.errors for one in found[name]])
            share = 100 * float(np.mean(ratios < COVERED))
            rows.append(Row(f"{name}: corners inside 95 %", share, 98, "%", at_least=92))
            rows.append(Row(f"{name}: mean error", float(errors.mean()), np.inf, "mm"))
    return rows


if __name__ == "__main__":
    quick = "--quick" in sys.argv[1:]
    rest = [word for word in sys.argv[1:] if word != "--quick"]
    count = QUICK_DRAWS if quick else DRAWS
    sys.exit(main(f"Uncertainty, {count} cells drawn", lambda: measure(count), rest))
