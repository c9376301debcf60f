"""Whether corners stay what they are on a rigid base where what carries the arm sways.

Carriers of 2, 4 and 8 Hz, damping 1 and 5 %, whose mass is such that steps of the scan leave
0.5 mm, root mean square; then one of another make: two coupled modes with a spring that hardens and
dry friction, integrated by SciPy's solver. Beside them the same scan that takes each profile as the
arm arrives, and a taught path without any correction, on a joint that stands some millimetres off.

Waiting the worst case out means: after each move as long as the slowest decaying of these carriers
takes from 0.5 mm to the tolerance. ``--seeds N`` scans N times with each instead of 3 times;
``--quick`` with two seeds; ``--first N`` begins at another seed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from _table import Row, main, numbers_to_draw
from scipy.integrate import solve_ivp
from uncertainty import across_edges

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core import pose_vector
from tjscan.core.errors import GrooveNotFound
from tjscan.core.frames import Array, JointOrBaseFrame, transform_points
from tjscan.groove.read import read_groove
from tjscan.job.cell import Cell
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.recording.journal import CombinedJournal
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import SwayMode, SwaySettings
from tjscan.robot.simulated import SimulatedArm
from tjscan.robot.sway import SimulatedSway
from tjscan.runs.scan.results import sections_in_result_frame
from tjscan.runs.scan.run import ScanContext, scan_in_cell
from tjscan.runs.scan.uncertainty import causes_of_job
from tjscan.scanning.section import ProfileView, Substep
from tjscan.uncertainty.causes import budget_of_causes

JOB: Final = Path(__file__).resolve().parents[1] / "examples" / "paper.toml"
CARRIERS: Final = [(f, d) for f in (2.0, 4.0, 8.0) for d in (0.01, 0.05)]
AMPLITUDE: Final = 0.5e-3
TOLERANCE: Final = 0.03e-3
DIRECTION: Final = (0.6, 0.5, 0.6)
PIVOT_MM: Final = (0.0, 400.0, 2500.0)
"""The beam that the arm hangs from."""

PAYLOAD: Final = 2.0
LENGTH_MM: Final = 240.0
SETTLE: Final[dict[str, Any]] = {"scan.settle.tolerance_mm": 1e3 * TOLERANCE}
JOINT_MM: Final = (522.0, 903.0, -128.0)
OFF_MM: Final = ((3.0, -2.0, 2.0), (30.0, -20.0, 20.0))
"""How far the joint stands from where a taught path takes it to be."""

WORST_WAIT: Final = float(np.log(AMPLITUDE / TOLERANCE) / (0.01 * 2 * np.pi * 2.0))
"""Seconds in which the slowest decaying carrier comes from 0.5 mm to the tolerance."""


@dataclass(frozen=True)
class Scanned:
    """Corners' distances from their edges, mm; error² over what is stated; seconds; views."""

    errors: Array
    squares: Array
    seconds: float
    views: tuple[ProfileView, ...]


def swaying(frequency: float, damping: float, mass: float) -> dict[str, Any]:
    """Keys of a carrier."""
    mode = {
        "frequency_hz": frequency,
        "damping": damping,
        "direction": list(DIRECTION),
        "pivot_mm": list(PIVOT_MM),
        "mass_kg": mass,
    }
    return {"simulation.arm.sway": {"payload_kg": PAYLOAD, "mode": [mode]}}


def job_of(keys: dict[str, Any], seed: int) -> tuple[ScanJob, ScanContext]:
    """The example with keys replaced."""
    job = read_scan_job(JOB, {"scan.length_mm": LENGTH_MM, "simulation.seed": seed} | keys)
    return job, ScanContext(job, JOB)


def corner_errors(job: ScanJob, context: ScanContext, points_b: Any) -> Array:
    """Distances of corners from the edges where the joint truly stands, mm."""
    if context.joint is None or job.joint is None:
        raise SystemExit(f"{JOB} names no joint to compare with")
    T = JointOrBaseFrame(job.joint.T_w_j).T_r_b
    corners = np.array([transform_points(T, one) for one in points_b])
    return 1e3 * np.asarray(corner_to_edge_distances(corners, feature_edges(context.joint)))


def scan(keys: dict[str, Any], seed: int, sway: Any = None) -> Scanned:
    """Scan the example; `sway` stands in place of the job's."""
    job, context = job_of(keys, seed)
    cell = context.make_cell()
    if sway is not None:
        arm_of(cell).sway = sway
    result = scan_in_cell(cell, job, CombinedJournal())
    errors = corner_errors(job, context, [one.points_b for one in result.sections])
    joint = context.joint
    if joint is None or job.joint is None:
        raise SystemExit(f"{JOB} names no joint to compare with")
    frame = JointOrBaseFrame(job.joint.T_w_j)
    causes = causes_of_job(job, context.sensor_mount, result.sections)
    budget = budget_of_causes(causes.causes, frame.T_r_b, len(result.sections))
    sections = budget.sections_with_covariances(
        sections_in_result_frame(result.sections, frame, "1")
    )
    squares = across_edges(sections, feature_edges(joint)).squares
    with cell:
        end = arm_of(cell).state().time
    return Scanned(errors, squares, end, result.views)


def arm_of(cell: Cell) -> SimulatedArm:
    """The simulated arm under the checks of its paths."""
    arm: Any = cell.arm
    return arm.moving_arm  # type: ignore[no-any-return]


def mass_for(frequency: float, damping: float, views: tuple[ProfileView, ...]) -> float:
    """Mass with which steps of a scan leave 0.5 mm (root mean square), each from rest."""
    kinematics = Kinematics.load("ur10e")
    mode = SwayMode(
        frequency=frequency,
        damping=damping,
        direction=DIRECTION,
        pivot=tuple(1e-3 * v for v in PIVOT_MM),  # type: ignore[arg-type]
        mass=1.0,
    )
    table, left = SwaySettings(mode=(mode,), payload=PAYLOAD), []
    for before, after in pairwise(views):
        if after.substep is not Substep.PREDICTION:
            continue
        arm = SimulatedArm(kinematics, before.q, repeatability=(0, 0))
        arm.sway = SimulatedSway(table, np.random.default_rng(0))
        with arm:
            arm.move_linear(kinematics.forward(after.q))
            shown = []
            for _ in range(40):
                arm.pass_time(1 / (40 * frequency))
                shown.append(abs(arm.sway.displacements[0]))
        left.append(max(shown))
    return float(np.sqrt(np.mean(np.square(left)))) / AMPLITUDE


def taught_path(keys: dict[str, Any], seed: int, taught: list[Array]) -> tuple[Array, int]:
    """Corner errors along a taught path without any correction, mm, and sections not read."""
    job, context = job_of(keys, seed)
    points, lost = [], 0
    with context.make_cell() as cell:
        for T_b_f in taught:
            state = cell.arm.move_joint_to_pose(T_b_f)
            try:
                groove = read_groove(cell.laser.capture(), job.groove)
            except GrooveNotFound:
                lost += 1
            else:
                points.append(transform_points(state.T_b_f @ cell.T_f_s, groove.points_s))
    return corner_errors(job, context, points), lost


class OtherCarrier:
    """A carrier of another make: displacement and turn, coupled, hardening, with dry friction."""

    payload = PAYLOAD

    def __init__(self, frequency: float, mass: float) -> None:
        self._w, self._mass = 2 * np.pi * frequency, mass
        self._state, self._momentum = np.zeros(4), np.zeros(2)
        along = np.array(DIRECTION) / np.linalg.norm(DIRECTION)
        self._shapes = np.array(((*along, 0, 0, 0), (0.3, -0.4, 0, 0, 0, 0.4)))

    @property
    def T_rest_b(self) -> Array:
        """As of `SimulatedSway`."""
        return pose_vector.pose_from_vector(self._state[:2] @ self._shapes)

    def advance(self, seconds: float, momentum: Array | None = None) -> None:
        """As of `SimulatedSway`."""
        now = np.zeros(2) if momentum is None else self._shapes @ momentum
        self._state[2:] -= (now - self._momentum) / self._mass
        self._momentum = now
        found = solve_ivp(self._law, (0, seconds), self._state, rtol=1e-6, atol=1e-9)
        self._state = found.y[:, -1]

    def _law(self, _time: float, state: Array) -> Array:
        x, v = state[:2], state[2:]
        square = self._w**2 * np.array((1.0, 1.7**2))
        spring = square * x * (1 + (x / 2e-3) ** 2) + 0.1 * self._w**2 * x[::-1]
        friction = 1e-3 * np.tanh(v / 1e-3) + 0.02 * self._w * v
        return np.concatenate((v, -spring - friction))


def p95(runs: list[Array]) -> float:
    """Of all corners, mm."""
    return float(np.percentile(np.concatenate(runs), 95))


def rows_of(name: str, runs: list[Scanned], rigid: list[Scanned]) -> Iterator[Row]:
    """Bars of one carrier."""
    ratio = p95([one.errors for one in runs]) / p95([one.errors for one in rigid])
    yield Row(f"{name}: corners p95, settled, to rigid", ratio, 1.2)
    moving = float(np.mean([one.seconds for one in rigid]))
    spent, looks = (
        float(np.mean(of))
        for of in zip(*((one.seconds, len(one.views)) for one in runs), strict=True)
    )
    worst = moving + looks * WORST_WAIT
    yield Row(f"{name}: time against waiting the worst case out", spent / worst, 0.6)
    yield Row(f"{name}: … seconds of a burst", (spent - moving) / looks, np.inf, "s")
    nees = float(np.concatenate([one.squares for one in runs]).mean()) / 2
    yield Row(f"{name}: error² / stated", nees, 1.5)


def rows_beside(
    name: str,
    carrier: tuple[float, float],
    keys: dict[str, Any],
    settled: Scanned,
    taught: list[Array],
) -> Iterator[Row]:
    """What is stated beside them, of one seed."""
    arrived = scan(keys, 1).errors
    yield Row(f"{name}: corners p95, corrected, as it arrives", p95([arrived]), np.inf, "mm")
    yield Row(f"{name}: … sections until it ends", len(arrived), np.inf)
    for off in OFF_MM:
        stands = [a + b for a, b in zip(JOINT_MM, off, strict=True)]
        size = np.linalg.norm(off)
        blind, lost = taught_path(keys | {"joint.position_mm": stands}, 1, taught)
        beside = f"{name}: taught path, joint {size:.0f} mm off"
        yield Row(f"{beside}: corners p95", p95([blind]), np.inf, "mm")
        yield Row(f"{beside}: … sections not read", lost, np.inf)
    frequency, damping = carrier
    shaper = {"frequency_hz": 1.05 * frequency, "damping": damping}
    shaped = scan(keys | SETTLE | {"arm.shaper": shaper}, 1)
    yield Row(f"{name}: corners p95, shaped and settled", p95([shaped.errors]), np.inf, "mm")
    longer = shaped.seconds / settled.seconds
    yield Row(f"{name}: … its time to that of settled alone", longer, np.inf)


def measure(seeds: range) -> Iterator[Row]:
    """Rows of the bench."""
    rigid = [scan({}, seed) for seed in range(1, 13)]
    yield Row("rigid: corners p95", p95([one.errors for one in rigid]), np.inf, "mm")
    nees = float(np.concatenate([one.squares for one in rigid]).mean()) / 2
    yield Row("rigid: error² / stated", nees, np.inf)
    yield Row("rigid: time of a scan", rigid[0].seconds, np.inf, "s")
    yield Row("worst case: seconds of its wait after a move", WORST_WAIT, np.inf, "s")
    views = rigid[0].views
    taught = [one.T_b_f for one in views if one.substep is not Substep.PREDICTION]
    every: list[Scanned] = []
    for carrier in CARRIERS:
        name = f"{carrier[0]:g} Hz, {carrier[1]:.0%}"
        keys = swaying(*carrier, mass_for(*carrier, views))
        runs = [scan(keys | SETTLE, seed) for seed in seeds]
        yield from rows_of(name, runs, rigid)
        yield from rows_beside(name, carrier, keys, runs[0], taught)
        every += runs
    yield from rows_of("all of these", every, rigid)
    mass = mass_for(3.0, 0.02, views)
    other = [scan(SETTLE, seed, OtherCarrier(3.0, mass)) for seed in seeds]
    yield from rows_of("of another make", other, rigid)


if __name__ == "__main__":
    ARGUMENTS = sys.argv[1:]
    DRAWN = numbers_to_draw(ARGUMENTS, "--seeds", 3, first=1)
    sys.exit(main("A carrier that sways", lambda: measure(DRAWN), ARGUMENTS))
