"""Views of one groove by an arm whose links stand as its joint angles say, without simulation."""

from __future__ import annotations

from functools import cache

import numpy as np
from rings import GROOVE

from tjscan.core.frames import Array, pose, rot_x, rot_y
from tjscan.laser.profile import Profile
from tjscan.robot.kinematics import Kinematics
from tjscan.scanning.section import ProfileView, ScannedSection, Substep

T_F_S = pose(rot_x(0.3) @ rot_y(-0.2), (0.02, -0.115, 0.168))


@cache
def ur10e() -> Kinematics:
    return Kinematics.load("ur10e")


def views(count: int, seed: int = 0) -> list[ScannedSection]:
    """Sections seen from `count` poses about one: neighbours on a groove, and turned."""
    rng = np.random.default_rng(seed)
    home = np.radians((-110, -95, 130, 105, -110, 0))
    return [view_at(home + rng.uniform(-0.5, 0.5, 6), k) for k in range(count)]


def view_at(q: Array, index: int = 0) -> ScannedSection:
    T_b_f = ur10e().forward(q)
    nothing = Profile(np.zeros(1), np.zeros(1))
    view = ProfileView(
        index, Substep.CORRECTION, T_b_f, T_b_f @ T_F_S, nothing, float(index), np.asarray(q)
    )
    return ScannedSection(view, GROOVE, np.eye(4))
