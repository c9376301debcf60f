"""One scan all round five joints, the arm on a gantry and the joint on a turn-table.

Each is placed by ``tjscan place --carrier`` and scanned as the job stands, by an exact carrier and
by one that is 0.3 mm and 0.05° off at each stop. The least number of moves is searched on a grid of
the carrier's positions by a code of its own. ``--quick`` takes the first two joints.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import tomli_w
from _table import Row, main, numbers_to_draw
from uncertainty import across_edges

from tjscan.calibration.wizard.operator import DefaultAnswerOperator
from tjscan.cli.output.scan import scan_progress_bar
from tjscan.core.config import read_toml, validate_table
from tjscan.core.errors import TjscanError
from tjscan.core.frames import Array, inverse_pose
from tjscan.job.cell import clear_path_planner_of_job
from tjscan.job.devices import CarrierSettings
from tjscan.job.files import CarrierFile, ScanJob, read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.joint.file import read_joint
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.place.job import place_joint
from tjscan.runs.scan.ideal_views import ideal_sensor_pose
from tjscan.runs.scan.run import ScanContext
from tjscan.runs.stations.run import run_stations, stitch_station_runs

ROOT: Final = Path(__file__).resolve().parents[1]
CARRIERS: Final = ("gantry", "turn-table")
JOINTS: Final = (
    (600.0, 20.0, 457.2, 25.4, 90.0),
    (406.4, 16.0, 323.9, 16.0, 90.0),
    (508.0, 20.0, 406.4, 20.0, 80.0),
    (457.2, 16.0, 323.9, 12.7, 75.0),
    (610.0, 25.4, 355.6, 16.0, 90.0),
)
"""Outer diameter and wall of leg and brace, mm, and their angle; the paper's joint comes first."""

OFF_MM, OFF_DEG = 0.3, 0.05
AZIMUTHS, OVERLAP = 36, 3
"""Round the groove, of the exhaustive search, and those that neighbouring stops share."""

CELL: Final = {
    "scan.step_mm": 30.0,
    "arm.uncertainty.absolute_mm": 0.0,
    "laser.uncertainty.linearity_mm": 0.0,
}
"""Steps of the example of two stations; simulated arm and laser are stated to err as they do."""

LARGEST_TURN: Final = np.radians(60)
"""Of a joint from azimuth to azimuth: a larger one is a jump."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a joint on a carrier: moves, the least possible, and figures of two scans."""

    moves: float
    least: float
    covered: tuple[float, float]
    mean_mm: tuple[float, float]
    nees: tuple[float, float]
    error: str = ""


def write_joint(folder: Path, number: int) -> Path:
    """A joint's file."""
    leg, leg_wall, brace, wall, angle = JOINTS[number]
    paper = number == 0
    table = {
        "leg": {
            "outer_diameter_mm": leg,
            "wall_mm": leg_wall,
            "length_mm": 1400.0 if paper else round(2.2 * leg + 200.0),
        },
        "brace": {
            "outer_diameter_mm": brace,
            "wall_mm": wall,
            "length_mm": 650.0 if paper else round(leg / 2 + 350.0),
            "angle_deg": angle,
        },
        "groove": {
            "angle_deg": [[90.0, 50.0], [140.0, 65.0]],
            "root_opening_mm": 4.0,
            "root_face_mm": 1.5,
            "root_bead_mm": 2.0,
        },
    }
    file = folder / "joint.toml"
    file.write_text(tomli_w.dumps(table), encoding="utf-8")
    return file


def carrier_named(name: str) -> CarrierSettings:
    """Of the examples."""
    file = ROOT / "examples" / f"carrier-{name}.toml"
    return validate_table(CarrierFile, read_toml(file), file).carrier


def scan(job_file: Path, out: Path, keys: dict[str, Any]) -> tuple[float, float, float]:
    """Degrees covered, mean corner error in mm, and NEES, of one scan all round."""
    job = read_scan_job(job_file, keys)
    context = ScanContext(job, job_file)
    scans = run_stations(context, out, DefaultAnswerOperator(), scan_progress_bar)
    short = [one.name for one in scans if not one.is_complete]
    if short:
        raise SystemExit(f"{short} is not complete")
    done = stitch_station_runs(out)
    joint = context.joint
    if joint is None:
        raise SystemExit("no joint")
    found = across_edges(done.stitched.sections, feature_edges(joint))
    return done.report.covered_deg, float(found.errors.mean()), float(found.squares.mean()) / 2


def measure_one(number: int, name: str) -> Outcome:
    """Place, scan twice and search exhaustively."""
    nothing = (math.nan, math.nan)
    with TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        file, carrier = write_joint(folder, number), carrier_named(name)
        try:
            template = ROOT / "examples" / "ur10e.toml"
            placed = place_joint(file, template, folder, CELL, carrier=carrier)
            job_file = folder / "job.toml"
            job_file.write_text(tomli_w.dumps(placed.table), encoding="utf-8")
            moves, least = len(placed.stations) - 1, least_moves(read_scan_job(job_file), file)
            off = {
                "carrier.sigma_mm": OFF_MM,
                "carrier.sigma_deg": OFF_DEG,
                "carrier.simulated.error_mm": OFF_MM,
                "carrier.simulated.error_deg": OFF_DEG,
            }
            exact = scan(job_file, folder / "exact", {})
            beside = scan(job_file, folder / "off", off)
        except (TjscanError, SystemExit) as error:
            return Outcome(math.nan, math.nan, nothing, nothing, nothing, str(error))
        covered, mean_mm, nees = zip(exact, beside, strict=True)
        return Outcome(moves, least, covered, mean_mm, nees)


def least_moves(job: ScanJob, joint_file: Path) -> float:
    """The fewest moves on a grid of the carrier's positions, by brute force."""
    carrier, arm, joint = job.carrier, Kinematics.load(job.arm.model), read_joint(joint_file)
    if carrier is None or job.joint is None:
        raise SystemExit("no carrier")
    phi = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    T_s_f = inverse_pose(np.array(ScanContext(job, joint_file).sensor_mount.T_f_s))
    plan = job.scan
    T_w_f = [job.joint.T_w_j @ ideal_sensor_pose(joint, a, plan) @ T_s_f for a in phi]
    grids = [
        np.linspace(*axis.bounds, 25 if axis.kind == "rotary" else 10) for axis in carrier.axis
    ]
    farthest = [0] * AZIMUTHS  # number of azimuths reached from each on
    here = job.job_at_station(job.station_names[0])
    for values in product(*grids):
        runs = runs_from(arm, here, np.array(values), np.array(T_w_f))
        farthest = list(map(max, farthest, runs))
    best = math.inf
    for start in range(AZIMUTHS):
        at, stops = start + int(farthest[start]), 1
        while at < start + AZIMUTHS + OVERLAP:
            further = max(
                at - OVERLAP - back + int(farthest[(at - OVERLAP - back) % AZIMUTHS])
                for back in range(AZIMUTHS)
            )
            if further <= at or stops > 8:
                stops = 99
                break
            at, stops = further, stops + 1
        best = min(best, stops - 1)
    return best


def runs_from(arm: Kinematics, here: ScanJob, values: Array, T_w_f: Array) -> list[int]:
    """How many azimuths are reached in one sweep from each azimuth on, the carrier somewhere."""
    there = here.with_carrier_at(values)
    clear = clear_path_planner_of_job(there).clearance_check()
    q = arm.inverse_branches(inverse_pose(there.T_w_b) @ T_w_f)
    best = [0] * AZIMUTHS
    for branch in np.moveaxis(q, 1, 0):
        good = np.isfinite(branch).all(axis=1)
        turn = (np.roll(branch, -1, axis=0) - branch + np.pi) % (2 * np.pi) - np.pi
        with np.errstate(invalid="ignore"):
            joined = good & np.roll(good, -1) & (np.abs(turn).max(axis=1) < LARGEST_TURN)
        if joined.sum() < 3:
            continue
        for i in np.flatnonzero(good):
            wrapped = (branch[i] + np.pi) % (2 * np.pi) - np.pi
            good[i] = clear(wrapped) and (
                arm.smallest_singular_value(wrapped) >= here.clearance.singular
            )
        joined &= good & np.roll(good, -1)
        for start in range(AZIMUTHS):
            count = int(good[start])
            while count and count < AZIMUTHS and joined[(start + count - 1) % AZIMUTHS]:
                count += 1
            best[start] = max(best[start], count)
    return best


def measure(numbers: range) -> Iterator[Row]:
    """Rows of the bench."""
    asked = [(number, name) for number in numbers for name in CARRIERS]
    with ProcessPoolExecutor(2) as pool:
        found = list(pool.map(measure_one, *zip(*asked, strict=True)))
    for (number, name), one in zip(asked, found, strict=True):
        print(f"joint {number}, {name}: {one}", file=sys.stderr)
    whole = [min(one.covered, default=0.0) > 359 for one in found]
    yield Row("joints on carriers, scanned all round", 100 * float(np.mean(whole)), 100, "%", 100)
    yield Row("carrier moves beyond the least possible", max(o.moves - o.least for o in found), 1)
    for k, (what, limit) in enumerate((("exact", 0.06), (f"{OFF_MM} mm, {OFF_DEG}° off", 0.12))):
        means = [one.mean_mm[k] for one in found]
        yield Row(f"corners, carrier {what}: mean of all", float(np.mean(means)), limit, "mm")
        yield Row("… of the worst", max(means), math.inf, "mm")
        nees = float(np.mean([one.nees[k] for one in found]))
        yield Row("… NEES / 2, mean of all", nees, 1.5, at_least=0.7)


if __name__ == "__main__":
    ARGUMENTS = sys.argv[1:]
    NUMBERS = numbers_to_draw(ARGUMENTS, "--joints", len(JOINTS), first=0)
    sys.exit(main("all round by a carrier", lambda: measure(NUMBERS), ARGUMENTS))
