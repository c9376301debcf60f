"""Sections laid round a groove that is a perfect ring."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tjscan.core.frames import Array, inverse_pose, pose, rot_z
from tjscan.groove.section import GrooveSection, section_from_points
from tjscan.laser.profile import Profile
from tjscan.scanning.plan import ScanPlan
from tjscan.scanning.section import ProfileView, ScannedSection, Substep
from tjscan.scanning.target import REVERSED_FRAME_ROTATION, ScanDirection

RADIUS = 0.2286
GROOVE = section_from_points(
    1e-3 * np.array(((50, 0, 230), (20, 0, 230), (5, 0, 255), (0, 0, 255), (-40, 0, 190))),
    covariance=np.diag([(0.03e-3) ** 2] * 6 + [1e-6] * 2),
)
PLAN = ScanPlan()


def ring_pose(turned: float) -> Array:
    """Frame g on the ring: x counterclockwise, y up, z out."""
    R = rot_z(turned) @ np.array(((0, 0, 1), (1, 0, 0), (0, 1, 0)))
    return pose(R, RADIUS * rot_z(turned)[:, 0])


def ring_section(
    turned: float,
    index: int = 2,
    *,
    groove: GrooveSection = GROOVE,
    plan: ScanPlan = PLAN,
    off: Array | None = None,
    substep: Substep = Substep.CORRECTION,
) -> ScannedSection:
    """A section that is seen as the plan wants it, but for `off`, a change of frame t in t."""
    reverse = (
        pose(REVERSED_FRAME_ROTATION) if plan.direction is ScanDirection.CLOCKWISE else np.eye(4)
    )
    T_b_g, T_s_t = ring_pose(turned), plan.target_pose_in_sensor(groove.work_angle)
    T_b_s = T_b_g @ reverse @ (np.eye(4) if off is None else off) @ inverse_pose(T_s_t)
    seen = section_seen(groove, inverse_pose(T_b_s) @ T_b_g)
    nothing = Profile(np.zeros(1), np.zeros(1))
    return ScannedSection(
        ProfileView(index, substep, T_b_s, T_b_s, nothing, 0.0, np.zeros(6)), seen, T_s_t
    )


def section_seen(groove: GrooveSection, T_s_g: Array) -> GrooveSection:
    """The same section, seen from elsewhere."""
    return replace(groove, T_s_g=T_s_g)
