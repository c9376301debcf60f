"""Arms that deviate, and arcs of a ball that they would see, by equations of their own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final, Self

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.calibration.arm.calibrate import ArmModel, TargetInPostures, calibrate_arm
from tjscan.calibration.arm.wizard import PlannedPosture, PosturePlan, plan_postures
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.targets.ball import SphereModel, SphereTarget
from tjscan.core.frames import Array, pose
from tjscan.laser.model import MeasuringRange
from tjscan.robot.deviations import deviate_joint_frames
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance

T_F_S: Final = pose(p=(-0.0007, -0.1148, 0.1676))
CENTRE_B: Final = np.array((0.6, -0.3, 0.15))
RADIUS: Final = 0.03
WINDOW: Final = MeasuringRange(near=0.190, far=0.290, apex_z=-0.028, half_angle=0.188, columns=640)
NOISE: Final = NoiseModel(position=3e-5, rotation=6e-5)
ARC_SIGMA: Final = np.array((20e-6, 15e-6, 20e-6))
AHEAD_S: Final = np.array((0.0, 0.0, 0.24, 1.0))
"""Middle of the sensor's range: where it measures."""
ANYWHERE: Final = 200
NEAREST: Final = 0.35
"""Metres of the sensor's middle from the base's axis: nearer, no arm is used."""


@cache
def kinematics() -> Kinematics:
    """The arm as its maker draws it."""
    return Kinematics.load("ur10e")


@cache
def views() -> tuple[PlannedPosture, ...]:
    """Postures as the wizard would plan them."""
    plan = PosturePlan(
        CENTRE_B, RADIUS, T_F_S, WINDOW, NOISE, PlacementTolerance(), poses=44, held_out=12
    )
    planned = plan_postures(plan, kinematics())
    used = [view for view in planned if not view.held_out][:44]
    return (*used, *[view for view in planned if view.held_out][:12])


@cache
def work_space() -> Array:
    """Postures with the sensor above the floor and in front of the base, shape (n, 6)."""
    rng = np.random.default_rng(0)
    kept: list[Array] = []
    while len(kept) < ANYWHERE:
        q = rng.uniform(-np.pi, np.pi, 6)
        x, y, z = (kinematics().forward(q) @ T_F_S @ AHEAD_S)[:3]
        if z > 0 and np.hypot(x, y) > NEAREST:
            kept.append(q)
    return np.array(kept)


@dataclass(frozen=True, slots=True, eq=False)
class BallArm:
    """An arm as it truly is, and its own random numbers."""

    true: Kinematics
    rng: np.random.Generator

    @classmethod
    def drawn(cls, seed: int) -> Self:
        """Draw an arm as its maker leaves it."""
        rng = np.random.default_rng(seed)
        deviations = PlacementTolerance().sigmas * rng.standard_normal((6, 6))
        return cls(deviate_joint_frames(kinematics(), deviations), rng)

    def seen(self, chosen: list[PlannedPosture]) -> ArmModel:
        """Arcs of the ball: the circle in which the laser plane cuts it, with noise."""
        centres, radii = [], []
        for view in chosen:
            step = self.rng.standard_normal(6) * np.repeat((NOISE.position, NOISE.rotation), 3)
            T_b_f = self.true.forward(view.q)
            R_b_s = Rotation.from_rotvec(step[3:]).as_matrix() @ T_b_f[:3, :3] @ T_F_S[:3, :3]
            p_b_s = (
                T_b_f[:3, 3]
                + step[:3]
                + Rotation.from_rotvec(step[3:]).apply(T_b_f[:3, :3] @ T_F_S[:3, 3])
            )
            x, y, z = R_b_s.T @ (CENTRE_B - p_b_s)
            off = ARC_SIGMA * self.rng.standard_normal(3)
            centres.append((x + off[0], 0.0, z + off[1]))
            radii.append(np.sqrt(RADIUS**2 - y**2) + off[2])
        q, T_b_f = (np.array([getattr(view, name) for view in chosen]) for name in ("q", "T_b_f"))
        arcs = SphereModel(
            T_b_f,
            np.array(centres),
            np.array(radii),
            np.tile(np.diag(ARC_SIGMA**2), (len(q), 1, 1)),
            SphereTarget(),
            NOISE,
        )
        start = np.append(CENTRE_B, RADIUS)
        return ArmModel(kinematics(), (TargetInPostures(arcs, q, T_b_f, start),))


def posture_errors(arm: BallArm) -> tuple[float, float, float, float]:
    """RMS errors of an arm before and after, metres: over the work space, and of held-out arcs.

    Over the work space of the middle of the sensor's range, the base frame being fitted, as a
    laser tracker would.
    """
    held_out = np.array([view.held_out for view in views()])
    found = calibrate_arm(arm.seen(list(views())), held_out, PlacementTolerance(), T_F_S)
    true = _places(arm.true, T_F_S)
    calibrated = deviate_joint_frames(kinematics(), found.estimate.deviations)
    return (
        _off(_places(kinematics(), T_F_S), true),
        _off(_places(calibrated, found.estimate.T_f_s), true),
        found.error_before,
        found.error_after,
    )


def _places(arm: Kinematics, T_f_s: Array) -> Array:
    return np.array([(arm.forward(q) @ T_f_s @ AHEAD_S)[:3] for q in work_space()])


def _off(found: Array, true: Array) -> float:
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    turn, _ = Rotation.align_vectors(b, a)
    return float(np.sqrt(np.mean(np.sum((turn.apply(a) - b) ** 2, axis=1))))
