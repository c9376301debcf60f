"""Sections along a joint's groove by geometry alone: no arm, no rays, noise as it is stated."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.core.frames import (
    Array,
    inverse_pose,
    pose,
    rotation_angle_between,
    transform_points,
    unit_vector,
)
from tjscan.groove.section import GrooveSection, section_from_points
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import FeatureEdges, feature_edges
from tjscan.joint.file import read_joint
from tjscan.laser.profile import Profile
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import ProfileView, ScannedSection, SetPoint, Substep
from tjscan.scanning.target import ScanDirection, correction_target_pose

CAD = Path(__file__).parent.parent.parent / "cad"
SEEN_OF_BRACE, SEEN_OF_LEG = 0.031, 0.070
"""Metres of both that a profile holds beside the groove."""
NOTHING = Profile(np.zeros(4), np.zeros(4))


@dataclass(frozen=True)
class Noise:
    """Standard deviations: of points (m), of tangents (rad), of the arm's pose (m, rad)."""

    points: float = 0.015e-3
    tangents: float = np.radians(0.1)
    position: float = 0.05e-3 / np.sqrt(3)
    rotation: float = 1e-4 / np.sqrt(3)


NONE = Noise(0.0, 0.0, 0.0, 0.0)


@dataclass
class Seam:
    """A joint, frame j being frame b, and how noisily it is seen."""

    definition: JointDefinition
    edges: FeatureEdges
    direction: ScanDirection = ScanDirection.COUNTERCLOCKWISE
    noise: Noise = NONE
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    T_b_j: Array = field(default_factory=lambda: np.eye(4))

    @property
    def plan(self) -> ScanPlan:
        return ScanPlan(direction=self.direction)

    def look(self, to: SetPoint, index: int = 2) -> ScannedSection:
        """Lay frame t on its set-point and read the section."""
        T_b_s = to.T_b_t @ inverse_pose(to.T_s_t)
        n = self.noise
        away = self.rng.standard_normal(6) * ([n.position] * 3 + [n.rotation] * 3)
        true = T_b_s @ pose(Rotation.from_rotvec(away[3:]).as_matrix(), away[:3])
        groove = self.section(inverse_pose(self.T_b_j) @ true)
        view = ProfileView(
            index, Substep.PREDICTION, T_b_s, T_b_s, NOTHING, float(index), np.zeros(6)
        )
        return ScannedSection(view, groove, to.T_s_t)

    def section(self, T_j_s: Array) -> GrooveSection:
        """What a laser plane cuts out of the joint."""
        joint, n = self.definition, self.noise
        T_s_j, y_j = inverse_pose(T_j_s), T_j_s[:3, 1]
        middle = transform_points(T_j_s, (0.0, 0.0, 0.235))
        lines = (self.edges.p2, self.edges.p3, self.edges.p4)
        corners = np.array([_cut(T_s_j, line.points_j, middle) for line in lines])
        up, out = np.array((0.0, 0.0, 1.0)), unit_vector(corners[2] * (1, 1, 0))
        wall = _within(np.cross(unit_vector(corners[0] * (1, 1, 0)), y_j), -up)
        leg = _within(np.cross(joint.leg_surface.normal(corners[2]), y_j), out)
        ends = (
            _on_tube(corners[0] - SEEN_OF_BRACE * wall, y_j, up, joint.brace_radius),
            _on_tube(corners[2] + SEEN_OF_LEG * leg, y_j, joint.leg_surface.axis, joint.leg_radius),
        )
        points_s = transform_points(T_s_j, np.array((ends[0], *corners, ends[1])))
        points_s[:, [0, 2]] += n.points * self.rng.standard_normal((5, 2))
        points_s[:, 1] = 0.0
        tangents_s = [_turned(v @ T_j_s[:3, :3], n.tangents * self.rng.standard_normal())
                      for v in (wall, leg)]  # fmt: skip
        covariance = np.diag([n.points**2] * 6 + [n.tangents**2] * 2)
        return section_from_points(
            points_s, wall_s=tangents_s[0], leg_s=tangents_s[1], covariance=covariance
        )

    def ideal(self, last: ScannedSection, near: ScannedSection, step: float) -> ScannedSection:
        """The section, seen without noise, whose ideal set-point is where it was seen from."""
        exact = Seam(self.definition, self.edges, self.direction, T_b_j=self.T_b_j)
        scan = near
        for _ in range(10):
            T_b_t = correction_target_pose(last.T_b_g, scan.T_b_g)
            short = step - np.linalg.norm(scan.T_b_g[:3, 3] - last.T_b_g[:3, 3])
            T_b_t[:3, 3] += short * T_b_t[:3, 0]
            to = SetPoint(T_b_t, self.plan.target_pose_in_sensor(scan.groove.work_angle))
            scan = exact.look(to, near.view.index)
        return scan

    def walk(self, azimuth: float, step: float, sections: int) -> list[ScannedSection]:
        """Ideal sections from an azimuth on, read with this noise."""
        exact = Seam(self.definition, self.edges, self.direction, T_b_j=self.T_b_j)
        sign = 1.0 if self.direction is ScanDirection.COUNTERCLOCKWISE else -1.0
        scans = [exact.look(self._beside(azimuth - sign * step / self.definition.brace_radius))]
        for i in range(sections):
            at = azimuth + sign * i * step / self.definition.brace_radius
            near = exact.look(self._beside(at), i)
            scans.append(self.ideal(scans[-1], near, step))
        return [self.look(SetPoint(scan.T_b_t, scan.T_s_t), scan.view.index) for scan in scans[1:]]

    def _beside(self, azimuth: float) -> SetPoint:
        """About where the groove lies at an azimuth."""
        joint = self.definition
        ccw = self.direction is ScanDirection.COUNTERCLOCKWISE
        x = joint.leg_surface.tangent(azimuth, joint.brace_radius) * (1 if ccw else -1)
        out = np.array((np.cos(azimuth), np.sin(azimuth), 0.0))
        y = unit_vector(np.cross(out if ccw else -out, x))
        T_j_t = pose(
            np.column_stack((x, y, np.cross(x, y))),
            joint.leg_surface.points_j(azimuth, joint.brace_radius),
        )
        return SetPoint(self.T_b_j @ T_j_t, self.plan.target_pose_in_sensor(0.15))


@cache
def _joint(name: str) -> tuple[JointDefinition, FeatureEdges]:
    definition = read_joint(CAD / f"{name}.toml")
    return definition, feature_edges(definition)


def seam(
    name: str = "tjoint-600x457",
    direction: ScanDirection = ScanDirection.COUNTERCLOCKWISE,
    noise: Noise = NONE,
    seed: int = 0,
) -> Seam:
    """A joint of the project's."""
    return Seam(*_joint(name), direction, noise, np.random.default_rng(seed))


def misses(to: SetPoint, ideal: ScannedSection) -> tuple[float, float]:
    """How far a set-point is from an ideal view: metres, and radians of the sensor."""
    T_b_s = to.T_b_t @ inverse_pose(to.T_s_t)
    return (
        float(np.linalg.norm(to.T_b_t[:3, 3] - ideal.T_b_g[:3, 3])),
        rotation_angle_between(T_b_s, ideal.view.T_b_s),
    )


def _cut(T_s_j: Array, line_j: Array, near_j: Array) -> Array:
    """Where a closed line passes through the laser plane next to a point."""
    i = int(np.argmin(np.sum((line_j - near_j) ** 2, axis=1)))
    part = line_j[(np.arange(-500, 501) + i) % len(line_j)]
    y = transform_points(T_s_j, part)[:, 1]
    through = np.flatnonzero(np.diff(np.sign(y)) != 0)
    k = through[np.argmin(np.abs(through - 500))]
    return np.asarray(part[k] + y[k] / (y[k] - y[k + 1]) * (part[k + 1] - part[k]))


def _within(v: Array, towards: Array) -> Array:
    return unit_vector(v if v @ towards > 0 else -v)


def _on_tube(p: Array, normal: Array, axis: Array, radius: float) -> Array:
    """The point of a tube next to `p` in the plane with this normal."""
    for _ in range(5):
        across = p - (p @ axis) * axis
        outside = np.linalg.norm(across) - radius
        slope = unit_vector(across) - (unit_vector(across) @ normal) * normal
        p = p - outside * slope / (slope @ slope)
    return p


def _turned(v_s: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array((c * v_s[0] - s * v_s[2], 0.0, s * v_s[0] + c * v_s[2]))
