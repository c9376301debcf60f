"""Where along a groove the stations of a run reach with a torch."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError, PoseUnreachable
from tjscan.core.frames import (
    Array,
    inverse_pose,
    pose,
    rot_z,
    transform_points,
)
from tjscan.core.units import MM
from tjscan.job.cell import collision_model_of_job, kinematics_of_job
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.planning.document import LengthEntry
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.lay import PlannedBead
from tjscan.planning.plan import WeldPlan
from tjscan.planning.stops import StationStretch
from tjscan.planning.urscript import BeadPath, StationPath
from tjscan.planning.wps import TorchSettings
from tjscan.result.directory import JOB_FILE
from tjscan.result.summary import read_stitching_report
from tjscan.robot.collision import SCANNED_GROOVE_NAME
from tjscan.robot.deviations import deviate_joint_frames
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import LARGEST_JOINT_TURN, linear_waypoints
from tjscan.robot.tool_reach import NEAR_SINGULARITY_TEXT, Hindrance, ToolConfigurations
from tjscan.runs.scan.run import ScanContext
from tjscan.scanning.journal import grid_triangles

SOLE_STATION_NAME: Final = "arm"
"""Name of the station of a job without stations."""


@dataclass(frozen=True, slots=True, eq=False)
class WeldingStation:
    """An arm at the place from which the groove was scanned.

    Parameters
    ----------
    name : str
        Of the station; `SOLE_STATION_NAME` for a job without stations.
    job : ScanJob
        Of that station alone.
    job_file : Path
        The file that it was read from.
    model, kinematics : Kinematics
        The arm as its controller has it, and as it was calibrated.
    T_b_r : ndarray, shape (4, 4)
        Frame of the run's sections in the arm's base frame.
    """

    name: str
    job: ScanJob
    job_file: Path
    model: Kinematics
    kinematics: Kinematics
    T_b_r: Array

    def hindrance_check(self, torch: TorchSettings, groove: Array, reserve: float) -> Hindrance:
        """What keeps the arm with a torch from a configuration.

        The solids of the job, whose frame w is known if the job states the joint's pose in
        it; the arm itself; and the measured groove. A solid of the torch that enters the groove is
        held against that alone.

        Parameters
        ----------
        torch : TorchSettings
            The torch and its mount, in place of what the job has the arm carry.
        groove : ndarray, shape (k, 5, 3)
            The groove's surface: five points of each of k sections, in frame r, metres.
        reserve : float
            How much further apart than the margins, metres.
        """
        table, T_b_w = self.job.clearance, None
        if self.job.joint is not None and self.job.station:
            T_b_w = self.T_b_r @ inverse_pose(self.job.joint.T_w_j)
        model = collision_model_of_job(self.job, self.kinematics, torch.solid, T_b_w)
        surface = transform_points(self.T_b_r, groove.reshape(-1, 3))
        model.set_measured_surface(surface, grid_triangles(*groove.shape[:2]))
        of_torch = {one.name: one.in_groove for one in torch.solid}

        def least(moving: str, other: str, *, own: bool) -> float:
            if own:
                return table.own
            if of_torch.get(moving):
                return 0.0 if other == SCANNED_GROOVE_NAME else -np.inf
            return torch.margin if moving in of_torch else table.solids

        margins = np.array([least(pair.moving, pair.other, own=pair.own) for pair in model.pairs])
        check = model.make_nearness_check(margins + reserve)

        def hindrance(q: Array) -> str:
            near = check(q)
            return "" if near is None else f"{near.moving} would touch {near.other}"

        return hindrance

    def commanded_pose(self, T_b_f: Array, q: Array) -> Array:
        """Pose to command so that the flange truly gets to a pose; (4, 4)."""
        if self.kinematics is self.model:
            return T_b_f
        return np.asarray(T_b_f @ inverse_pose(self.kinematics.forward(q)) @ self.model.forward(q))


def welding_stations(directory: Path, frame: str) -> tuple[WeldingStation, ...]:
    """Arms of a run, at the stations from which it was scanned, in the order of its job.

    Parameters
    ----------
    directory : Path
        The run directory, of one scan or stitched.
    frame : str
        Letter of the frame of its sections.

    Raises
    ------
    ConfigurationError
        If the run does not state the place of its arm, or that can't be read.
    """
    report = read_stitching_report(directory)
    if report is None:
        job, T_b_r = _read_job(directory), np.eye(4)
        if frame == "j":
            if job.joint is None or job.station:
                raise ConfigurationError("does not state the pose of the joint", key="joint")
            T_b_r = job.joint.T_w_j
        name = job.station_names[0] if job.station else SOLE_STATION_NAME
        return (_make_station(name, job, directory, T_b_r),)
    order = _read_job(directory).station_names if (directory / JOB_FILE).is_file() else ()
    found = []
    for one in report.stations:
        folder = directory / one.source
        found.append(_make_station(one.name, _read_job(folder), folder, inverse_pose(one.T_j_b)))
    return tuple(sorted(found, key=lambda s: order.index(s.name) if s.name in order else 0))


def _make_station(name: str, job: ScanJob, folder: Path, T_b_r: Array) -> WeldingStation:
    file = folder / JOB_FILE
    with add_file_to_errors(file):
        model = kinematics_of_job(job)
        deviations = ScanContext(job, file).sensor_mount.deviations
    calibrated = model if deviations is None else deviate_joint_frames(model, deviations)
    return WeldingStation(name, job, file, model, calibrated, T_b_r)


def _read_job(folder: Path) -> ScanJob:
    if not (folder / JOB_FILE).is_file():
        raise ConfigurationError("the run holds no job that states its arm's place", file=folder)
    return read_scan_job(folder / JOB_FILE)


REACH_STEP: Final = 25e-3
"""Metres along the groove between the places at which holds are looked for."""

EXTRA_COLLISION_MARGIN: Final = 1e-3
"""Metres further than the margins at these places, for what is between them."""

GROOVE_SURFACE_SPACING: Final = 10e-3
"""Metres between sections of the groove's surface: a tube's chords stay 0.1 mm off it."""


def rounded_mm(length: float) -> float:
    """Metres along the groove as millimetres of a plan's document."""
    return round(length / MM.factor, 1)


@dataclass(frozen=True, slots=True, eq=False)
class StationReach:
    """What a station reaches of a groove with its torch.

    Parameters
    ----------
    station : WeldingStation
        The arm.
    hindrance : callable
        What keeps it from a configuration.
    places : ndarray, shape (m,)
        Where holds were looked for, metres along the groove.
    length : float
        Of the groove, metres.
    holds : ToolConfigurations
        What was found.
    """

    station: WeldingStation
    hindrance: Hindrance
    places: Array
    length: float
    holds: ToolConfigurations

    @property
    def longest(self) -> tuple[int, int] | None:
        """First and last place of the longest stretch along which the torch can be led."""
        found = self.holds.stretches()
        return max(found, key=lambda one: one[1] - one[0], default=None)

    @property
    def stretch(self) -> StationStretch | None:
        """That stretch along the groove."""
        found = self.longest
        if found is None or found[0] == found[1]:
            return None
        return StationStretch(self.station.name, *(float(self._along(np.array(i))) for i in found))

    @property
    def usual_hindrance(self) -> str:
        """What prevents it at most places."""
        return Counter(self.holds.hindrances).most_common(1)[0][0]

    @property
    def unreached(self) -> tuple[LengthEntry, ...]:
        """Lengths of groove beyond that stretch, and what prevents them."""
        first, last = self.longest or (0, -1)
        m, step = len(self.places), self.places[1] - self.places[0]
        reached = {i % m for i in range(first, last + 1)}
        found = list[tuple[float, float, str]]()
        for i in (i for i in range(m) if i not in reached):
            begin = at = float(self.places[i])
            reason = self.holds.hindrances[i] or "a joint would have to jump"
            if found and found[-1][2] == reason and at - found[-1][1] < 1.5 * step:
                begin, *_ = found.pop()
            found.append((begin, at, reason))
        return tuple(
            LengthEntry(begin_mm=rounded_mm(begin), end_mm=rounded_mm(end), reason=reason)
            for begin, end, reason in found
        )

    def lead_torch(self, plan: WeldPlan) -> StationPath:
        """Lead the torch along this station's beads, one after the other.

        Between beads it is drawn back along the wire and goes back over the bead it has laid.

        Parameters
        ----------
        plan : WeldPlan
            With beads of this station.

        Raises
        ------
        PoseUnreachable
            If something is in the way between the places that were looked at.
        """
        begin, end = self.longest or (0, 0)
        spins, q = self.holds.path(begin, end)
        q = _turn_joints_within_limits(q, self.station)
        at = self._along(np.arange(begin, end + 1))
        torch, arm = plan.wps.torch, self.station.kinematics
        T_tool_f = inverse_pose(torch.tcp.T)
        leader = _TorchLeader(self.station, torch.tcp.T, self.hindrance)
        found, before, passed = list[BeadPath](), np.empty((0, 4, 4)), np.empty((0, q.shape[1]))
        for bead in (bead for bead in plan.beads if bead.station == self.station.name):
            turns = np.round((0.5 * (at[0] + at[-1]) - bead.s.mean()) / self.length)
            s = bead.s + turns * self.length * self.holds.closed
            spun = np.array([pose(rot_z(spin)) for spin in np.interp(s, at, spins)])
            T = self.station.T_b_r @ bead.T_r_torch @ spun
            where = f"bead {bead.number} of station {self.station.name}"
            held = np.transpose([np.interp(s, at, angles) for angles in q.T])
            first, last = (leader.draw_back(T[k], held[k], torch.retract) for k in (0, -1))
            if not found:
                start = leader.q = arm.inverse(first @ T_tool_f, near=held[0])
            way = leader.lead_on_lines(np.concatenate((before, [first, T[0]])), where)
            path = leader.lead_along_bead(T, bead, where)
            leave = leader.lead_on_lines(last[None], where)
            found.append(BeadPath(bead, way, path, leave))
            # Points half a retraction apart: the way back needs no more.
            apart = bead.length / (len(bead.s) - 1)
            back_over = slice(None, None, -max(1, int(0.5 * torch.retract / apart)))
            passed = held[back_over]
            before = np.array(
                [
                    leader.draw_back(pose_there, q_there, torch.retract)
                    for pose_there, q_there in zip(T[back_over], passed, strict=True)
                ]
            )
        return StationPath(self.station.name, start, tuple(found))

    def _along(self, i: NDArray[np.int64]) -> Array:
        """Metres along the groove of places, beyond its length after a turn."""
        m = len(self.places)
        return np.asarray(self.places[i % m] + self.length * (i // m))


RETRACTION_SHARES: Final = (1.0, 0.75, 0.5)
"""Of the distance by which a torch is drawn back, that are tried at the end of the arm's reach."""

LARGEST_TURN_DRAWN_BACK: Final = 0.5 * np.pi
"""A joint that is turned further from where it is on the bead is of another posture of the arm."""


class _TorchLeader:
    """Leads an arm from pose to pose of its tool, and checks that nothing is in the way."""

    def __init__(self, station: WeldingStation, T_f_tool: Array, hindrance: Hindrance) -> None:
        self._station, self._T_f_tool, self._hindrance = station, T_f_tool, hindrance
        self._T_tool_f = inverse_pose(T_f_tool)
        self.q = np.zeros(6)

    def lead_on_lines(self, poses: Array, where: str) -> Array:
        """On lines to poses of the tool, shape (k, 4, 4); as the controller is commanded."""
        commanded = []
        for T in poses:
            T_b_f = T @ self._T_tool_f
            try:
                path, _ = linear_waypoints(self._station.kinematics, self.q, T_b_f)
            except PoseUnreachable as error:
                raise PoseUnreachable(f"on the way to {where}: {error.reason}", T_b_f) from None
            for q in path[1:]:
                self._refuse_hindered_pose(q, T_b_f, f"on the way to {where}")
            self.q = path[-1]
            commanded.append(self._commanded_tool_pose(T_b_f))
        return np.array(commanded)

    def draw_back(self, T: Array, held: Array, retract: float) -> Array:
        """Pose of the tool drawn back from T, (4, 4), as far as the arm can without a new posture.

        The whole of `retract`, metres, or less where the arm is at the end of its reach; `held`
        is how it holds the tool beside T, shape (6,).
        """
        for share in RETRACTION_SHARES:
            drawn: Array = T @ pose(p=(0.0, 0.0, -share * retract))
            with suppress(PoseUnreachable):
                q = self._station.kinematics.inverse(drawn @ self._T_tool_f, near=held)
                if np.abs(q - held).max() < LARGEST_TURN_DRAWN_BACK:
                    return drawn
        return T @ pose(p=(0.0, 0.0, -retract))

    def lead_along_bead(self, poses: Array, bead: PlannedBead, where: str) -> Array:
        """Along a bead's poses, shape (q, 4, 4); as the controller is commanded."""
        commanded = []
        for T, s in zip(poses, bead.s, strict=True):
            T_b_f, here = T @ self._T_tool_f, f"at s = {1e3 * s:.0f} mm of {where}"
            q = self._station.kinematics.inverse(T_b_f, near=self.q)
            if np.abs(q - self.q).max() > LARGEST_JOINT_TURN:
                raise PoseUnreachable(f"{here}: a joint would have to swing at once", T_b_f)
            self._refuse_hindered_pose(q, T_b_f, here)
            self.q = q
            commanded.append(self._commanded_tool_pose(T_b_f))
        return np.array(commanded)

    def _refuse_hindered_pose(self, q: Array, T_b_f: Array, where: str) -> None:
        arm, least = self._station.kinematics, self._station.job.clearance.singular
        is_singular = arm.smallest_singular_value(q) < least
        reason = NEAR_SINGULARITY_TEXT if is_singular else self._hindrance(q)
        if reason:
            raise PoseUnreachable(f"{where}: {reason}", T_b_f)

    def _commanded_tool_pose(self, T_b_f: Array) -> Array:
        return self._station.commanded_pose(T_b_f, self.q) @ self._T_f_tool


def find_station_reach(station: WeldingStation, plan: WeldPlan, groove: Array) -> StationReach:
    """Find what a station reaches of a plan's beads, all of them with the same spin at a place.

    Parameters
    ----------
    station : WeldingStation
        The arm.
    plan : WeldPlan
        The plan, its beads whole.
    groove : ndarray, shape (k, 5, 3)
        The groove's surface, see `groove_surface`.

    Raises
    ------
    ConfigurationError
        If the arm has no closed form of its inverse kinematics.
    """
    edges, torch = plan.edges, plan.wps.torch
    count = ceil(edges.length / REACH_STEP)
    places = np.linspace(0.0, edges.length, count + 1)[: count if edges.closed else None]
    T = station.T_b_r @ torch_poses(plan, places)
    arm, singular = station.kinematics, station.job.clearance.singular
    wary = station.hindrance_check(torch, groove, EXTRA_COLLISION_MARGIN)
    holds = ToolConfigurations(arm, torch.tcp.T, T, wary, singular=singular, closed=edges.closed)
    hindrance = station.hindrance_check(torch, groove, 0.0)
    return StationReach(station, hindrance, places, edges.length, holds)


def groove_surface(edges: GrooveEdges, sections: Array) -> Array:
    """Surface of the smoothed groove and beside it, as far as it was measured.

    Parameters
    ----------
    edges : GrooveEdges
        The groove.
    sections : ndarray, shape (k, 5, 3)
        The five points of each measured section, metres.

    Returns
    -------
    ndarray, shape (m, 5, 3)
        p1 to p5 of m sections along the groove; of one that closes, the first again at the end.
    """
    s = np.linspace(0.0, edges.length, ceil(edges.length / GROOVE_SURFACE_SPACING) + 1)
    p3, p4, _, p2 = np.moveaxis(edges.corners(s), 1, 0)
    period = edges.length if edges.closed else None
    wall, leg = (
        np.transpose([np.interp(s, edges.sections, x, period=period) for x in beside.T])
        for beside in (sections[:, 0] - sections[:, 1], sections[:, 4] - sections[:, 3])
    )
    return np.stack((p2 + wall, p2, p3, p4, p4 + leg), axis=1)


def torch_poses(plan: WeldPlan, places: Array) -> Array:
    """Poses of the torch that a station has to hold at places along the groove.

    On all beads that pass there, and drawn back from those that are laid first and last.

    Parameters
    ----------
    plan : WeldPlan
        The plan, its beads whole.
    places : ndarray, shape (m,)
        Metres along the groove.

    Returns
    -------
    ndarray, shape (m, n, 4, 4)
        In frame r; the first one of a place again where fewer beads pass.
    """
    found = [_torch_poses_at(plan, float(place)) for place in places]
    most = max(map(len, found))
    return np.array([poses + poses[:1] * (most - len(poses)) for poses in found])


def _torch_poses_at(plan: WeldPlan, s: float) -> list[Array]:
    back = pose(p=(0.0, 0.0, -plan.wps.torch.retract))
    near = [(bead, _nearest_point_of_bead(bead, s, plan.edges)) for bead in plan.beads]
    least = min(away for _, (_, away) in near)
    here = [(bead, bead.T_r_torch[i]) for bead, (i, away) in near if away <= max(least, REACH_STEP)]
    outer = {here[0][0].layer, here[-1][0].layer}
    return [T for _, T in here] + [T @ back for bead, T in here if bead.layer in outer]


def _nearest_point_of_bead(bead: PlannedBead, s: float, edges: GrooveEdges) -> tuple[int, float]:
    """Which point of a bead is nearest to a place, and how far away, metres."""
    away = np.abs(bead.s - s)
    if edges.closed:
        away = np.abs((bead.s - s + 0.5 * edges.length) % edges.length - 0.5 * edges.length)
    i = int(np.argmin(away))
    return i, float(away[i])


def _turn_joints_within_limits(q: Array, station: WeldingStation) -> Array:
    """Joint angles of a path, shape (k, n), whole turns on so that they are within their limits."""
    arm = station.kinematics
    middle = 0.5 * (arm.lower + arm.upper)
    turns = np.round((middle - 0.5 * (q.min(axis=0) + q.max(axis=0))) / (2 * np.pi))
    q = q + 2 * np.pi * turns
    over = np.maximum(arm.lower - q.min(axis=0), q.max(axis=0) - arm.upper)
    if over.max() > 0:
        name = arm.joint_names[int(np.argmax(over))]
        raise PoseUnreachable(
            f"{name} would have to turn beyond its limits along the groove: part it among more "
            "stations",
            arm.forward(q[0]),
        )
    return np.asarray(q)
