"""What two stations reach of the paper's joint with a torch, and their programs on the loopback."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.frames import Array, inverse_pose
from tjscan.job.cell import kinematics_of_job
from tjscan.job.files import read_scan_job
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.plan import WeldPlan, plan_weld
from tjscan.planning.stops import crowns_and_saddles
from tjscan.planning.urscript import StationPath, path_to_urscript
from tjscan.planning.wps import WeldingProcedure
from tjscan.runs.plan.reach import StationReach, WeldingStation, find_station_reach, groove_surface
from tjscan_loopback.ur.controller import LoopbackController

ROOT: Final = Path(__file__).parent.parent
JOB: Final = ROOT / "examples" / "whole-joint.toml"
OUTPUT: Final = 3
HZ: Final = 50.0
BESIDE: Final = 20e-3
"""Metres of the brace's wall that a scan sees beside the groove."""

ENDS: Final = 10e-3
"""Metres at either end of a bead where the arm gains speed and loses it."""


def stations() -> Iterator[WeldingStation]:
    """The arms of the example, where its job says that they stand."""
    job = read_scan_job(JOB)
    for name in job.station_names:
        at = job.job_at_station(name)
        arm = kinematics_of_job(at)
        joint = np.eye(4) if at.joint is None else at.joint.T_w_j
        T_b_r = inverse_pose(at.T_w_b) @ joint
        yield WeldingStation(name, at, JOB, arm, arm, T_b_r)


def find_reaches(
    edges: GrooveEdges, corners: Array, wps: WeldingProcedure, down: Array
) -> tuple[list[StationReach], WeldPlan]:
    """What both stations reach, and the plan parted among them.

    Parameters
    ----------
    edges : GrooveEdges
        The groove.
    corners : ndarray, shape (k, 4, 3)
        p3, p4, g and p2 of the sections that it was fitted to.
    wps : WeldingProcedure
        With the torch.
    down : ndarray, shape (3,)
        Of gravity.
    """
    p3, p4, g, p2 = np.moveaxis(corners, 1, 0)
    beside = BESIDE * np.array((0.0, 0.0, 1.0))
    leg = p4 + 1.5 * (g - p4)
    groove = groove_surface(edges, np.stack((p2 + beside, p2, p3, p4, leg), axis=1))
    plan = plan_weld(edges, wps, down)
    reaches = [find_station_reach(one, plan, groove) for one in stations()]
    stretches = tuple(found for one in reaches if (found := one.stretch) is not None)
    marks = crowns_and_saddles(edges, np.eye(4))
    return reaches, plan_weld(edges, wps, down, marks, stretches)


@dataclass(frozen=True, slots=True)
class FollowedProgram:
    """How a station's program was followed.

    Parameters
    ----------
    beads : int
        With the arc on, of as many as were planned.
    off_path : float
        Largest distance of the wire's tip from a bead's line with the arc on, metres.
    off_speed : float
        Largest difference from the planned speed, as a share of it, 10 mm from the ends on.
    off_ends : float
        Largest distance between where the arc went on or off, and a bead's end, metres.
    """

    beads: int
    off_path: float
    off_speed: float
    off_ends: float


def follow_program(reach: StationReach, way: StationPath, wps: WeldingProcedure) -> FollowedProgram:
    """Run a station's program on the loopback controller, and compare with the plan."""
    arm, tcp = reach.station.kinematics, wps.torch.tcp.T
    told: list[str] = []
    controller = LoopbackController(arm, way.q, hz=HZ, fast=False, report_line=told.append)
    controller.start_script(path_to_urscript(way, wps, OUTPUT, arc=True))
    runs, on = list[list[Array]](), False
    while told[-1] != "program stopped":
        controller.advance_one_tick()
        controller.resume_program()  # an operator who releases each layer at once
        before, on = on, bool(controller.digital_outputs >> OUTPUT & 1)
        if on and not before:
            runs.append([])
        if on:
            runs[-1].append((arm.forward(controller.q) @ tcp)[:3, 3])
    failed = [line for line in told if "failed" in line]
    if failed or len(runs) != len(way.beads):
        raise RuntimeError(f"{len(runs)} of {len(way.beads)} beads; {failed}")
    found = []
    for tips, one in zip(runs, way.beads, strict=True):
        points = (reach.station.T_b_r @ one.bead.T_r_torch)[:, :3, 3]
        found.append(_compare(np.array(tips), points, one.bead.speed))
    return FollowedProgram(len(runs), *(max(values) for values in zip(*found, strict=True)))


def _compare(tips: Array, points: Array, speed: Array) -> tuple[float, float, float]:
    chords = np.diff(points, axis=0)
    along = np.append(0.0, np.cumsum(np.linalg.norm(chords, axis=1)))
    from_start = tips[:, None] - points[:-1]
    share = np.clip(np.sum(from_start * chords, axis=2) / np.sum(chords**2, axis=1), 0, 1)
    away = np.linalg.norm(from_start - share[..., None] * chords, axis=2)
    j = away.argmin(axis=1)
    i = np.arange(len(tips))
    off, at = away[i, j], along[j] + share[i, j] * np.diff(along)[j]
    paces = HZ * np.linalg.norm(np.diff(tips, axis=0), axis=1)
    middles = 0.5 * (at[1:] + at[:-1])
    even = (middles > ENDS) & (middles < along[-1] - ENDS)
    wrong = np.abs(paces / np.interp(middles, along, speed) - 1)[even]
    return float(off.max()), float(wrong.max()), max(float(at.min()), float(along[-1] - at.max()))
