"""Stations whose arm hangs free in space: any stretch of a joint is scanned in no time.

The arm reaches every pose and obeys no joint limits; it errs as the simulated arm does. What the
laser sees, how the scan goes and how the groove is read is all as it is elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from cells import Notes
from scipy.spatial.transform import Rotation

from tjscan.core.devices import DeviceBase
from tjscan.core.frames import Array, inverse_pose, pose, pose_from_euler_zyx, unit_vector
from tjscan.groove.read import read_groove
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import JointGrooveSections
from tjscan.joint.file import read_joint
from tjscan.joint.mesh import build_joint_mesh
from tjscan.laser.model import LaserModel
from tjscan.laser.optics import RaycastSurface, SimulatedLaser
from tjscan.robot.arm import ArmState
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.profile_taker import ScanSetup
from tjscan.scanning.scanner import Scanner
from tjscan.scanning.target import ScanDirection
from tjscan.stitching.stations import Station, station_from_recording

CAD = Path(__file__).parent.parent.parent / "cad"
T_F_S = pose_from_euler_zyx((0.0, -0.1148, 0.1676), np.radians((0.7, 0.0, 0.5)))


@cache
def joint_named(name: str) -> JointDefinition:
    return read_joint(CAD / f"{name}.toml")


@cache
def surface_of(name: str) -> RaycastSurface:
    mesh = build_joint_mesh(joint_named(name))
    return RaycastSurface(mesh.vertices, mesh.triangles)


class FreeArm(DeviceBase):
    """An `Arm` without joints."""

    def __init__(self, rng: np.random.Generator, repeatability: float, angle: float) -> None:
        self._rng = rng
        self._spread = np.repeat([repeatability, angle], 3) / np.sqrt(3)
        self._T, self._error, self._time = np.eye(4), np.zeros(6), 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        pass

    @property
    def true_T_b_f(self) -> Array:
        turn = Rotation.from_rotvec(self._error[3:]).as_matrix()
        return pose(self._T[:3, :3] @ turn, self._T[:3, 3] + self._error[:3])

    def state(self) -> ArmState:
        return ArmState(np.zeros(6), self._T, self._time)

    def check_moves(self, *T_b_f: Array) -> None:
        pass

    def move_linear(self, T_b_f: Array) -> ArmState:
        self._T, self._time = np.array(T_b_f), self._time + 1.0
        self._error = self._spread * self._rng.standard_normal(6)
        return self.state()

    def move_joint_to_pose(
        self, T_b_f: Array, near: Array | None = None, *, direct: bool = False
    ) -> ArmState:
        return self.move_linear(T_b_f)

    def stop(self) -> None:
        pass

    def accept_moves_again(self) -> None:
        pass


DEFAULT_LASER = LaserModel()


@dataclass(frozen=True)
class Cast:
    """What the stations of a test have in common."""

    joint: str = "tjoint-600x457"
    step: float = 0.040
    model: LaserModel = DEFAULT_LASER
    repeatability: float = 5e-5
    angle: float = 1e-4
    nominal_error: float = 10e-3
    nominal_turn: float = np.radians(2.0)
    T_w_j: Array | None = None


def scan_station(name: str, start_deg: float, arc_deg: float, seed: int, cast: Cast) -> Station:
    """Scan an arc counterclockwise (clockwise where it is negative), and hand it in."""
    return true_station(name, start_deg, arc_deg, seed, cast)[0]


def true_station(
    name: str, start_deg: float, arc_deg: float, seed: int, cast: Cast
) -> tuple[Station, Array]:
    """The same, and where its base truly stands: T_j_b."""
    joint = joint_named(cast.joint)
    rng = np.random.default_rng([seed, *name.encode()])
    T_w_j = np.eye(4) if cast.T_w_j is None else cast.T_w_j
    start = np.radians(start_deg)
    amid = start + 0.5 * np.radians(arc_deg)
    beside = np.array((0.85 * np.cos(amid), 0.85 * np.sin(amid), 0.1))
    beside = beside + rng.uniform(-0.05, 0.05, 3)
    T_j_b = pose_from_euler_zyx(beside, rng.uniform(-0.5, 0.5, 3))
    away = unit_vector(rng.standard_normal(3)) * rng.uniform(0.5, 1) * cast.nominal_error
    turned = unit_vector(rng.standard_normal(3)) * rng.uniform(0.5, 1) * cast.nominal_turn
    T_w_b = T_w_j @ T_j_b
    nominal = pose(Rotation.from_rotvec(turned).as_matrix() @ T_w_b[:3, :3], T_w_b[:3, 3] + away)

    direction = ScanDirection.COUNTERCLOCKWISE if arc_deg > 0 else ScanDirection.CLOCKWISE
    length = abs(
        joint.leg_surface.arc_length(joint.brace_radius, start, start + np.radians(arc_deg))
    )
    taught = int(np.sign(arc_deg)) * cast.step / joint.brace_radius
    plan = ScanPlan(
        step=cast.step,
        direction=direction,
        length=max(length - cast.step, cast.step),
    )
    arm = FreeArm(rng, cast.repeatability, cast.angle)
    laser = SimulatedLaser(
        surface_of(cast.joint),
        lambda: T_j_b @ arm.true_T_b_f @ T_F_S,
        model=cast.model,
        rng=rng,
        clock=lambda: arm.state().time,
    )
    notes = Notes()
    with laser:
        scanner = Scanner(ScanSetup(arm, laser, T_F_S, read_groove), plan, notes)
        poses = [inverse_pose(T_j_b) @ view_of(joint, start + k * taught, plan) for k in (0, 1)]
        result = scanner.run(*poses)
    return station_from_recording(name, nominal, result.sections, result.views, read_groove), T_j_b


def view_of(joint: JointDefinition, phi: float, plan: ScanPlan) -> Array:
    """Flange pose in j from which the groove is seen as the scan wants it."""
    leg, r = joint.leg_surface, joint.brace_radius
    origin, x = leg.points_j(phi, r), leg.tangent(phi, r)
    if plan.direction is ScanDirection.CLOCKWISE:
        x = -x
    y = np.array((0.0, 0.0, 1.0))
    y = unit_vector(y - (y @ x) * x)
    groove = JointGrooveSections(joint, np.array([phi]))
    lean = float(groove.dihedral[0]) - np.pi / 2
    T_s_t = plan.target_pose_in_sensor(0.5 * float(groove.groove_angle[0]) - lean)
    T_j_t = pose(np.column_stack((x, y, np.cross(x, y))), origin)
    return T_j_t @ inverse_pose(T_F_S @ T_s_t)
