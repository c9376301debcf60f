"""Place a joint before an arm: the job that scans all of its groove, from the fewest stations."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.carrier.kinematics import AxisSettings
from tjscan.core.config import table_to_dict, validate_table
from tjscan.core.errors import (
    ArmFault,
    CarrierFault,
    JointOutOfReach,
    LaserFault,
    PoseUnreachable,
    StitchingRefused,
    message_with_notes,
)
from tjscan.core.frames import Array, Mask, inverse_pose, pose, rot_y, transform_points
from tjscan.job.carrier import CarrierSweep, carrier_of_job
from tjscan.job.cell import (
    SensorMount,
    clear_path_planner_of_job,
    joint_scene,
    kinematics_of_job,
    make_cell,
    sensor_mount_of_job,
)
from tjscan.job.devices import CarrierSettings
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import read_joint
from tjscan.recording.journal import CombinedJournal
from tjscan.robot.clearance import ClearPathPlanner
from tjscan.robot.collision import CollisionModel
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import Box, Cylinder, Solid, SolidShape
from tjscan.runs.place import search
from tjscan.runs.place.search import AZIMUTHS_TRIED, ReachedArc
from tjscan.runs.scan.ideal_views import (
    azimuth_further_along,
    ideal_sensor_pose,
    plan_with_centred_groove,
    pose_to_table,
)
from tjscan.runs.scan.run import groove_reader_of_job, scan_in_cell
from tjscan.scanning.journal import plan_is_fulfilled
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.target import ScanDirection
from tjscan.stitching.stations import (
    DEFAULT_STITCH_SETTINGS,
    fit_tubes_to_stations,
    station_from_recording,
)

ROOM_BELOW: Final = 0.55
"""Metres from the floor to the leg."""

MOUNT_RADIUS, MOUNT_LENGTH, MOUNT_ROOM = 0.1, 0.3, 0.15
"""Metres: of what a base stands on or hangs from, and how near its axis the tubes may come."""

LEAST_OVERLAP: Final = 30.0
"""Degrees of the groove that neighbouring stations both scan."""

SPARE_DEGREES: Final = 9.0
"""That a station reaches beyond what it scans: the joint stands elsewhere than stated, a little."""

DEGREES_APART: Final = 360.0 / AZIMUTHS_TRIED
"""Of places round the groove at which an arm is tried."""

MOST_STATIONS: Final = 7

SPARE_ROOM, SPARE_SINGULAR = 0.01, 1.5
"""Metres more than a job's margin that the arm keeps from what is around it, and by what it keeps
clearer of singularities: a scan differs from what is planned here."""

LONGEST_STEP_SHARE: Final = 0.1
"""Of the brace's diameter: a longer step of the template is shortened to it."""

POSTURES_DRAWN, POSTURE_SPREAD = 400, 0.7
"""In which an arm may be carried: how many are tried, and by how much each joint is away from where
a scan begins or ends, radians."""

RETREAT_DISTANCES: Final = (0.12, 0.08, 0.05, 0.03, 0.0)
"""Metres by which the arm begins behind its first taught pose, away from the groove."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedJoint:
    """Stations from which a joint is scanned all round, and the job that does so.

    Parameters
    ----------
    joint : JointDefinition
        The joint.
    T_w_j : ndarray, shape (4, 4)
        Where it stands: its leg level, w on the floor below, metres.
    stations : tuple of ReachedArc
        What each base reaches; their poses are in frame w.
    azimuths : ndarray, shape (n,)
        Round the groove, radians: those that arcs are counted by.
    table : dict
        The job, as a file has it.
    """

    joint: JointDefinition
    T_w_j: Array
    stations: tuple[ReachedArc, ...]
    azimuths: Array
    table: dict[str, Any]


def place_joint(
    joint_file: Path,
    template: Path,
    folder: Path,
    overrides: Mapping[str, Any],
    *,
    tilt: float = 0.0,
    direction: ScanDirection = ScanDirection.COUNTERCLOCKWISE,
    carrier: CarrierSettings | None = None,
) -> PlacedJoint:
    """Find where an arm stands to scan a joint all round, and make the job.

    Each station is scanned in simulation: a place is given up from which that ends early, or does
    not show where the joint is.

    Parameters
    ----------
    joint_file : Path
        The joint.
    template : Path
        A scan job whose arm, laser, mount, tool and margins are taken over.
    folder : Path
        Where the job will be.
    overrides : mapping
        Dotted keys of the template, and their values.
    tilt : float, optional
        Of the base towards the joint, radians: 0 upright, pi hanging.
    direction : ScanDirection, optional
        Which way round.

    Raises
    ------
    ConfigurationError
        If a file is wrong, the arm has no closed form of its inverse, or the groove doesn't fit
        into the laser's window.
    JointOutOfReach
        If no seven stations scan the groove all round.
    """
    simulated = dict.fromkeys(("arm.driver", "laser.driver"), "simulated")  # nothing real is moved
    job, joint = read_scan_job(template, dict(overrides) | simulated), read_joint(joint_file)
    scan = replace(job.scan, direction=direction, length=None, sections=None)
    view = replace(scan, length=2 * np.pi * joint.brace_radius, sections=None)
    window = job.laser.near, job.laser.far
    centred = plan_with_centred_groove(joint, 0.0, view, window)
    plan = replace(scan, standoff=centred.standoff, offset=centred.offset)
    mount = sensor_mount_of_job(job, template)
    searched = _Search(job, joint, plan, mount.T_f_s, tilt, carrier)
    arcs, whole, given_up = searched.arcs(), list[ReachedArc](), list[str]()
    while True:
        try:
            stations = searched.fewest_stations(arcs)
        except JointOutOfReach as error:
            if not given_up:
                raise
            raise JointOutOfReach(
                f"{error}. {len(given_up)} places were given up, the last because a simulated "
                f"scan there ended: {given_up[-1]}"
            ) from None
        table = _job_table(searched, stations)
        hindered = _hindered_station(searched, table, stations, whole, mount)
        if hindered is None:
            break
        arcs = [one for one in arcs if one is not hindered[0]]
        given_up.append(hindered[1])
    if carrier is not None:
        del table["simulation"]["station"]
        for station in table["station"][1:]:  # the station before gives these
            del station["first"], station["second"]
    table["joint"]["file"] = _path_from(folder, joint_file)
    if mount.file is not None:
        table["calibration"] = table["calibration"] | {"file": _path_from(folder, mount.file)}
    return PlacedJoint(joint, searched.T_w_j, stations, searched.azimuths, table)


def _hindered_station(
    searched: _Search,
    table: dict[str, Any],
    stations: tuple[ReachedArc, ...],
    whole: list[ReachedArc],
    mount: SensorMount,
) -> tuple[ReachedArc, str] | None:
    """The first station that a carrier does not get to, or whose simulated scan fails, and why.

    Those that are scanned whole are added to `whole`; the posture to carry the arm in, to `table`.
    """
    made = validate_table(ScanJob, table)
    if searched.carrier is not None and len(stations) > 1:
        home, i, reason = _posture_to_carry(made, stations)
        if home is None:
            return stations[i], reason
        degrees = np.round(np.degrees(home), 3).tolist()
        table["carrier"]["home_deg"] = degrees
        if degrees != np.round(np.degrees(searched.carrier.home or ()), 3).tolist():
            searched.carrier = replace(searched.carrier, home=tuple(home.tolist()))
            whole.clear()  # their scans began from, and ended in, another posture
        for station in table["simulation"]["station"][1:]:
            station["home_deg"] = degrees
        made = validate_table(ScanJob, table)
    for arc, at_station in zip(stations, made.jobs_at_stations, strict=True):
        if any(arc is one for one in whole):
            continue
        if reason := _hindrance_of_scan(at_station, searched.joint, mount):
            return arc, reason
        whole.append(arc)
    return None


def _hindrance_of_scan(job: ScanJob, joint: JointDefinition, mount: SensorMount) -> str:
    """Why a simulated scan does not do all that its job asks, or shows too little; or nothing."""
    cell = make_cell(job, mount, partial(joint_scene, job, joint))
    home = None if job.carrier is None else job.carrier.home
    try:
        if home is not None:
            with cell:
                near = np.array(job.station[0].posture)
                cell.arm.move_joint_to_pose(job.start_poses[0].T, near=near)
        result = scan_in_cell(cell, job, CombinedJournal())
        sections, read = result.sections, groove_reader_of_job(job)
        station = station_from_recording("", job.T_w_b, sections, result.views, read)
        fit_tubes_to_stations((station,), DEFAULT_STITCH_SETTINGS)
        if home is not None:
            with cell:
                T_b_f = cell.clearance.kinematics.forward(np.array(home))
                cell.arm.move_joint_to_pose(T_b_f, near=np.array(home))
    except (ArmFault, LaserFault, StitchingRefused) as error:
        return message_with_notes(error)
    return "" if plan_is_fulfilled(result.stop, job.scan) else result.detail


def _posture_to_carry(
    job: ScanJob, stations: Sequence[ReachedArc]
) -> tuple[Array | None, int, str]:
    """Joint angles in which a carrier brings an arm clear from station to station.

    None if there are none, with the number of the station that was not got to, and why.
    """
    carrier, arm = carrier_of_job(job), kinematics_of_job(job)
    stops = [carrier.values_si(station.carrier or ()) for station in job.station]
    jobs = [job.job_at_station(name) for name in job.station_names]
    clear = [clear_path_planner_of_job(one).clearance_check(SPARE_ROOM) for one in jobs]
    ends = np.array([q for arc in stations for q in (arc.q[0], arc.q[-1])])
    dice, least, most = np.random.default_rng(0), arm.lower, arm.upper
    drawn = ends[dice.integers(len(ends), size=POSTURES_DRAWN)]
    drawn = drawn + POSTURE_SPREAD * dice.standard_normal(drawn.shape)
    drawn = np.clip(drawn, np.maximum(least, -np.pi), np.minimum(most, np.pi))
    turned = np.abs(drawn[:, None] - ends).max(axis=2).max(axis=1)
    farthest, reason = 1, "no posture keeps clear at all stations"
    for q in (np.array(carrier.home), *drawn[np.argsort(turned)]):
        if not all(keeps_clear(q) for keeps_clear in clear):
            continue
        if arm.smallest_singular_value(q) < job.clearance.singular:
            continue
        sweep = CarrierSweep(jobs[0], arm, q)
        try:
            for i in range(1, len(stops)):
                at = i
                sweep.clear_way(stops[i - 1], stops[i])
        except CarrierFault as error:
            farthest, reason = max((farthest, reason), (at, str(error)))
        else:
            return np.asarray(q), 0, ""
    return None, farthest, reason


def _path_from(folder: Path, file: Path) -> str:
    return Path(os.path.relpath(file, folder)).as_posix()


class _Search:
    """What is known while places are tried."""

    def __init__(
        self,
        job: ScanJob,
        joint: JointDefinition,
        plan: ScanPlan,
        T_f_s: Array,
        tilt: float,
        carrier: CarrierSettings | None = None,
    ) -> None:
        self.job, self.joint, self.plan, self.tilt = job, joint, plan, tilt
        self.carrier = carrier
        self.kinematics = Kinematics.load(job.arm.model)
        # Some controllers have frame b at the shoulder; the root of a URDF is the arm's foot.
        self.T_b_foot = inverse_pose(self.kinematics.T_root_b)
        self.azimuths = 2 * np.pi * np.arange(AZIMUTHS_TRIED) / AZIMUTHS_TRIED
        if plan.direction is ScanDirection.CLOCKWISE:
            self.azimuths = -self.azimuths
        along = joint.leg_surface.axis
        R_w_j = np.array((along, (0.0, 1.0, 0.0), np.cross(along, (0.0, 1.0, 0.0))))
        self.T_w_j = pose(R_w_j, (0.0, 0.0, joint.leg_radius + ROOM_BELOW))
        self.T_s_f = inverse_pose(T_f_s)
        self.T_w_f = np.array([self.flange_at(azimuth) for azimuth in self.azimuths])

    def flange_at(self, azimuth: float) -> Array:
        """Ideal flange pose before the groove at an azimuth, in frame w."""
        T_j_s = ideal_sensor_pose(self.joint, azimuth, self.plan)
        return np.asarray(self.T_w_j @ T_j_s @ self.T_s_f)

    def groove_length(self, first: int, count: int) -> float:
        """Metres of the groove from an azimuth on, over so many."""
        azimuths = self.azimuths[np.arange(first, first + count) % AZIMUTHS_TRIED]
        joint = self.joint
        tangents = joint.leg_surface.azimuth_derivative(azimuths, joint.brace_radius)
        return float(np.linalg.norm(tangents, axis=1).sum() * 2 * np.pi / AZIMUTHS_TRIED)

    def arcs(self) -> list[ReachedArc]:
        """Arcs of which stations are chosen."""
        reach = search.reach_of_arm(self.kinematics)
        grid: list[Array] = [search.SIDES_TRIED, search.DISTANCES_TRIED, search.HEIGHTS_TRIED]
        if self.carrier is not None:
            grid = [_values_tried(axis, reach) for axis in self.carrier.axis]

        def base_at(place: search.Place) -> Array | None:
            if self.carrier is None:
                mount, origin_w = pose(rot_y(self.tilt)), self.T_w_j[:3, 3]
                T_w_b = search.base_about(place, origin_w, reach, mount)
            else:
                bounds = np.array([axis.bounds for axis in self.carrier.axis]).T
                if not ((bounds[0] <= place) & (place <= bounds[1])).all():
                    return None
                T_w_b = self.carrier.kinematics.T_w_b(place)
            return T_w_b if self._may_stand(T_w_b) else None

        places = search.BaseSearch(self.kinematics, self.T_w_f, grid, base_at, self._hindrance)
        spare = int(SPARE_DEGREES / DEGREES_APART)
        clear = [arc.without_ends(spare) for arc in places.arcs() if arc.count > 2 * spare]
        self.longest_unhindered = places.longest_unhindered
        return clear

    def fewest_stations(self, arcs: Sequence[ReachedArc]) -> tuple[ReachedArc, ...]:
        """The fewest stations of arcs; raises JointOutOfReach if they are not enough."""
        overlap = int(LEAST_OVERLAP / DEGREES_APART)
        found = search.fewest_stations(arcs, AZIMUTHS_TRIED, overlap, MOST_STATIONS)
        if not found:
            best = max((arc.count for arc in arcs), default=0) * DEGREES_APART
            within = self.longest_unhindered * DEGREES_APART
            raise JointOutOfReach(
                f"no {MOST_STATIONS} places of a {self.job.arm.model} reach the groove all round. "
                f"From the best one it scans {best:.0f}° of it; were nothing in its way, "
                f"{within:.0f}°. Try another --tilt-deg or carrier, a larger arm, or a smaller "
                "sensor"
            )
        return found

    @property
    def _hangs(self) -> bool:
        """Whether a base is on a bracket of its own, and on no pedestal."""
        return bool(self.tilt) or self.carrier is not None

    def _may_stand(self, T_w_b: Array) -> bool:
        """Whether what a base stands on passes the tubes, and is above the floor."""
        T_w_foot = T_w_b @ self.T_b_foot
        length = MOUNT_LENGTH if self._hangs else T_w_foot[2, 3]
        down = np.linspace(0.0, max(length, 0.0), 16)[:, None] * -T_w_foot[:3, 2]
        points = T_w_foot[:3, 3] + down
        if points[:, 2].min() < -1e-9:
            return False
        points_j = transform_points(inverse_pose(self.T_w_j), points)
        return not _near_tubes(self.joint, points_j).any()

    def solids(self, T_w_b: Array) -> dict[str, tuple[str, Solid]]:
        """What stands about, by name: the frame that it is stated in, and its solid there."""
        joint = self.joint
        along = joint.leg_surface.axis
        R_j_leg = np.column_stack((np.cross((0.0, 1.0, 0.0), along), (0.0, 1.0, 0.0), along))
        T_leg, T_brace = pose(R_j_leg), pose(p=(0.0, 0.0, joint.brace_length / 2))
        length = MOUNT_LENGTH if self._hangs else float((T_w_b @ self.T_b_foot)[2, 3])
        found: dict[str, tuple[str, SolidShape, Array]] = {
            "leg": ("w", Cylinder(joint.leg_radius, joint.leg_length), self.T_w_j @ T_leg),
            "brace": ("w", Cylinder(joint.brace_radius, joint.brace_length), self.T_w_j @ T_brace),
            "floor": ("w", Box((6.0, 6.0, 0.1)), pose(p=(0.0, 0.0, -0.06))),
        }
        # Where the arm's own base is, its mount is no body to keep clear of.
        if length > 0.1:
            middle = self.T_b_foot @ pose(p=(0.0, 0.0, -0.02 - length / 2))
            found["mount"] = ("b", Cylinder(MOUNT_RADIUS, length - 0.02), middle)
        return {name: (frame, Solid(name, shape, T)) for name, (frame, shape, T) in found.items()}

    def planner(self, T_w_b: Array) -> ClearPathPlanner:
        """Keeps the arm clear at a base."""
        T_b_w, table = inverse_pose(T_w_b), self.job.clearance
        solids = [
            one if frame == "b" else replace(one, T=T_b_w @ one.T)
            for frame, one in self.solids(T_w_b).values()
        ]
        tool = [one.solid for one in table.tool]
        own, ignored = table.self_collision, table.ignore
        model = CollisionModel(self.kinematics, solids, tool, self_collision=own, ignored=ignored)
        return ClearPathPlanner(self.kinematics, model, table)

    def _hindrance(self, T_w_b: Array) -> Callable[[Array], bool]:
        keeps_clear = self.planner(T_w_b).clearance_check(SPARE_ROOM)
        singular = SPARE_SINGULAR * self.job.clearance.singular

        def hindered(q: Array) -> bool:
            if not keeps_clear(q):
                return True
            return self.kinematics.smallest_singular_value(q) < singular

        return hindered


def _near_tubes(joint: JointDefinition, points_j: Array) -> Mask:
    """Which points, shape (n, 3), in frame j, are too near to leg or brace for a mount."""
    along = points_j @ joint.leg_surface.axis
    leg = joint.leg_surface.signed_distances(points_j) < MOUNT_ROOM
    beside = np.abs(along) < joint.leg_length / 2 + MOUNT_ROOM
    brace = np.hypot(points_j[:, 0], points_j[:, 1]) < joint.brace_radius + MOUNT_ROOM
    high = (points_j[:, 2] > 0) & (points_j[:, 2] < joint.brace_length + MOUNT_ROOM)
    return np.asarray((leg & beside) | (brace & high))


def _job_table(searched: _Search, stations: tuple[ReachedArc, ...]) -> dict[str, Any]:
    """The job as its file has it, but for the joint's file."""
    table = table_to_dict(searched.job)
    plan, joint = searched.plan, searched.joint
    step = min(plan.step, LONGEST_STEP_SHARE * 2 * joint.brace_radius)
    scan = {key: value for key, value in table["scan"].items() if key not in _REPLACED_SCAN_KEYS}
    scan |= {
        "direction": str(plan.direction),
        "step_mm": round(1e3 * step, 1),
        "standoff_mm": round(1e3 * plan.standoff, 1),
        "view_offset_mm": round(1e3 * plan.offset, 1),
    }
    names = [f"place-{n}" for n in range(1, len(stations) + 1)]
    made = [_station(searched, arc, step) for arc in stations]
    # The mount is the same at all stations: as long as at the lowest.
    lowest = min(stations, key=lambda arc: float(arc.T_w_b[2, 3]))
    solids = searched.solids(lowest.T_w_b).items()
    where = [pose_to_table(arc.T_w_b) for arc in stations]
    if (carrier := searched.carrier) is not None:
        table["carrier"] = {"home_deg": made[0][1]} | table_to_dict(carrier)
        table["carrier"]["driver"] = "simulated"  # nothing real is moved
        where = [
            {"carrier": list(carrier.values_in_file(np.array(arc.place))), **overlap}
            for arc, overlap in zip(stations, _overlaps(searched, stations), strict=True)
        ]
    table |= {
        "scan": scan,
        "station": [
            {"name": name, **place, **station}
            for name, place, (station, _) in zip(names, where, made, strict=True)
        ],
        "clearance": table["clearance"]
        | {"solid": [_solid_table(name, *placed) for name, placed in solids]},
        "joint": {"file": "", **pose_to_table(searched.T_w_j)},
    }
    simulation = {"seed": 1, "arm": {}} | (table.get("simulation") or {})
    simulation["arm"] = simulation["arm"] | {"home_deg": made[0][1], "realtime": False}
    simulation["station"] = [
        {"name": name, **pose_to_table(arc.T_w_b), "home_deg": home}
        for name, arc, (_, home) in zip(names, stations, made, strict=True)
    ]
    return table | {"simulation": simulation}


def _overlaps(searched: _Search, stations: tuple[ReachedArc, ...]) -> list[dict[str, Any]]:
    """How far stations overlap those before, and their postures, as their tables have it."""
    found: list[dict[str, Any]] = [{}]
    for before, arc in pairwise(stations):
        shared = (before.last - arc.first) % AZIMUTHS_TRIED
        length = searched.groove_length(arc.first, shared)
        found.append({"overlap_mm": round(1e3 * length, 1)})
    for table, arc in zip(found, stations, strict=True):
        table["posture_deg"] = np.round(np.degrees(arc.q[0]), 1).tolist()
    return found


def _values_tried(axis: AxisSettings, reach: float) -> Array:
    """Values of a carrier's axis that are tried first, metres or radians."""
    low, high = axis.bounds
    step = search.AXIS_TURN if axis.kind == "rotary" else search.AXIS_STEP * reach
    return np.linspace(low, high, 1 + max(1, math.ceil((high - low) / step)))


_REPLACED_SCAN_KEYS: Final = frozenset(("length_mm", "sections", "first", "second"))


def _station(searched: _Search, arc: ReachedArc, step: float) -> tuple[dict[str, Any], list[float]]:
    """Start poses and length of a station, and joint angles in degrees with which it begins."""
    joint, plan = searched.joint, searched.plan
    start = float(searched.azimuths[arc.first % AZIMUTHS_TRIED])
    whole = searched.groove_length(arc.first, arc.count)
    second = azimuth_further_along(joint, start % (2 * np.pi), step, plan.direction)
    T_b_w = inverse_pose(arc.T_w_b)
    first, further = (T_b_w @ searched.flange_at(azimuth) for azimuth in (start, second))
    home = _home(searched, arc, first)
    station = {
        "length_mm": round(1e3 * (whole - step), 1),
        "first": pose_to_table(first),
        "second": pose_to_table(further),
    }
    return station, np.round(np.degrees(home), 3).tolist()


def _home(searched: _Search, arc: ReachedArc, first: Array) -> Array:
    """Joint angles away from the groove, from which the way to the first pose is clear."""
    planner, q, T_f_s = searched.planner(arc.T_w_b), arc.q[0], inverse_pose(searched.T_s_f)
    for retreat in RETREAT_DISTANCES:
        T_b_f = first @ T_f_s @ pose(p=(0.0, 0.0, -retreat)) @ searched.T_s_f
        try:
            home = searched.kinematics.inverse(T_b_f, near=q)
        except PoseUnreachable:
            continue
        if planner.line_is_clear(home, q):
            return home
    return np.asarray(q)


def _solid_table(name: str, frame: str, solid: Solid) -> dict[str, Any]:
    shape = solid.shape
    size = (
        {"kind": "box", "size_mm": [1e3 * one for one in shape.size]}
        if isinstance(shape, Box)
        else {
            "kind": "cylinder",
            "radius_mm": round(1e3 * shape.radius, 1),
            "length_mm": round(1e3 * shape.length, 1),
        }
    )
    with warnings.catch_warnings():  # a cylinder that lies level is in gimbal lock, and round
        warnings.filterwarnings("ignore", "Gimbal lock")
        return {"name": name, "frame": frame, **size, **pose_to_table(solid.T)}
