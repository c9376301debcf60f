"""How well stations are stitched: the whole joint of the example, some draws of all errors."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from _stopwatch import Stopwatch
from _table import Row, main
from scipy.spatial.transform import Rotation

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core.errors import StitchingRefused
from tjscan.core.frames import Array, inverse_pose, pose, rotation_angle_between, unit_vector
from tjscan.job.files import read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.recording.journal import CombinedJournal
from tjscan.runs.scan.run import ScanContext, groove_reader_of_job, scan_in_cell
from tjscan.stitching.stations import Station, station_from_recording
from tjscan.stitching.stitch import StitchedGroove

EXAMPLE: Final = Path(__file__).resolve().parents[1] / "examples" / "whole-joint.toml"
SEEDS: Final = (1, 2, 3, 4, 5)
NOMINAL_ERRORS: Final = (10e-3, np.radians(2.0))
HALF_TURN: Final = np.diag((-1.0, -1.0, 1.0, 1.0))
"""An upright joint looks the same from behind."""

MOST_AT_BASE_MM: Final = 0.15
"""At the base's own origin, 1.1 m from all that was measured, 0.005° are 0.1 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Scanned:
    """Stations as scanned, and where they truly stand: T_j_b."""

    stations: tuple[Station, ...]
    truth: tuple[Array, ...]


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of one stitching, in mm and degrees."""

    place: float
    base: float
    turn: float
    diameter: float
    corners: tuple[float, float]
    gap: float
    covered: float


def scan(seed: int) -> Scanned:
    """Scan the example from both stations."""
    rng = np.random.default_rng(seed)
    stations, truth = [], []
    whole = read_scan_job(EXAMPLE, {"simulation.seed": seed})
    for name in whole.station_names:
        job = whole.job_at_station(name)
        joint = ScanContext(job, EXAMPLE).joint
        if joint is None or job.joint is None:
            raise SystemExit(f"{EXAMPLE} names no joint to compare with")
        cell = ScanContext(job, EXAMPLE).make_cell()
        result = scan_in_cell(cell, job, CombinedJournal())
        true = next(t.T for t in whole.simulation.station if t.name == name)  # type: ignore[union-attr]
        away, turned = (
            unit_vector(rng.standard_normal(3)) * rng.uniform(0.5, 1) * size
            for size in NOMINAL_ERRORS
        )
        off = pose(Rotation.from_rotvec(turned).as_matrix() @ true[:3, :3], true[:3, 3] + away)
        stations.append(
            station_from_recording(
                name, off, result.sections, result.views, groove_reader_of_job(job)
            )
        )
        truth.append(inverse_pose(job.joint.T_w_j) @ true)
    return Scanned(tuple(stations), tuple(truth))


def judge(stitched: StitchedGroove, scanned: Scanned) -> Errors:
    """Hold a stitching against the truth."""
    joint = ScanContext(read_scan_job(EXAMPLE), EXAMPLE).joint
    if joint is None:
        raise SystemExit(f"{EXAMPLE} names no joint to compare with")
    names = [station.name for station in scanned.stations]
    truth = [scanned.truth[names.index(one.fit.station.name)] for one in stitched.stations]
    found = [one.T_j_b for one in stitched.stations]
    turns = [max(map(rotation_angle_between, found, (turn @ T for T in truth))) for turn in _TURNS]
    truth = [_TURNS[int(np.argmin(turns))] @ T for T in truth]
    pairs = list(zip(found, truth, strict=True))
    shape = stitched.shape.as_array[:2] - (joint.brace_radius, joint.leg_radius)
    corners = np.array([section.points for section in stitched.sections])
    off = 1e3 * corner_to_edge_distances(corners, feature_edges(joint))
    return Errors(
        place=max(1e3 * float(np.linalg.norm(_joint_off(f, t))) for f, t in pairs),
        base=max(1e3 * float(np.linalg.norm(f[:3, 3] - t[:3, 3])) for f, t in pairs),
        turn=max(float(np.degrees(rotation_angle_between(f, t))) for f, t in pairs),
        diameter=2e3 * float(np.abs(shape).max()),
        corners=(float(off.mean()), float(np.percentile(off, 95))),
        gap=1e3 * (np.inf if stitched.gap_after is None else stitched.gap_after),
        covered=float(np.degrees(stitched.covered)),
    )


_TURNS: Final = (np.eye(4), HALF_TURN)


def _joint_off(found: Array, true: Array) -> Array:
    """How far the joint's origin lies from where it is, told in the base frame."""
    return inverse_pose(found)[:3, 3] - inverse_pose(true)[:3, 3]


def not_refused(scanned: Scanned) -> int:
    """Count the stitchings that were made of overlaps too small to hold them."""
    made = 0
    for keep in (26, 27, 28):
        short = scanned.stations[1]
        kept = short.sections[:keep]
        last = kept[-1].view.time
        every = tuple(one for one in short.all_sections if one.view.time <= last)
        try:
            stitched = StitchedGroove(
                [scanned.stations[0], replace(short, sections=kept, all_sections=every)]
            )
        except StitchingRefused:
            continue
        # Where the overlap is still large enough the stitching has to be right.
        made += judge(stitched, scanned).place > 0.2
    return made


def time_whole_scan() -> tuple[Stopwatch, bool]:
    """Time ``tjscan scan`` on the example, and say whether it left its report."""
    tjscan: Any = Path(sys.executable).with_name("tjscan")
    watch = Stopwatch()
    with TemporaryDirectory() as folder:
        with watch:
            subprocess.run(
                [tjscan, "scan", EXAMPLE, "--out", f"{folder}/run"], check=True, capture_output=True
            )
        return watch, (Path(folder) / "run" / "report.html").is_file()


def measure() -> list[Row]:
    """Measure every limit."""
    scans = [scan(seed) for seed in SEEDS]
    errors = [judge(StitchedGroove(one.stations), one) for one in scans]
    watch, told = time_whole_scan()
    n = len(SEEDS)
    return [
        Row("azimuth covered", min(e.covered for e in errors), np.inf, "°", at_least=359.999),
        Row(
            f"station pose, place of the joint, worst of {2 * n}",
            max(e.place for e in errors),
            0.1,
            "mm",
        ),
        Row(f"station pose, rotation, worst of {2 * n}", max(e.turn for e in errors), 0.02, "°"),
        Row("corners to feature edges, mean", max(e.corners[0] for e in errors), 0.1, "mm"),
        Row("corners to feature edges, p95", max(e.corners[1] for e in errors), 0.25, "mm"),
        Row("diameters", max(e.diameter for e in errors), 0.3, "mm"),
        Row("loop gap after closing", max(e.gap for e in errors), 0.1, "mm"),
        Row("overlaps too small: stitched, and wrong", not_refused(scans[0]), 0),
        Row(
            "the same pose told at the base, over a metre away",
            max(e.base for e in errors),
            MOST_AT_BASE_MM,
            "mm",
        ),
        Row("tjscan scan of the whole joint: reports missing", 0 if told else 1, 0),
        watch.row("tjscan scan of the whole joint, with report", max, 90e3),
    ]


if __name__ == "__main__":
    sys.exit(main("Stations stitched", measure, sys.argv[1:]))
