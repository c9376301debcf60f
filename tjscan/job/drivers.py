"""Arms and lasers by their tables: the drivers, real or simulated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import radians
from typing import Final

import numpy as np

from tjscan.calibration.file import rows_to_pose
from tjscan.core.config import naming
from tjscan.core.frames import Array, inverse
from tjscan.job import (
    ArmTable,
    LaserTable,
    SimulatedLaserTable,
    SimulationTable,
    UrTable,
)
from tjscan.laser.model import LaserModel
from tjscan.laser.optics import Surface
from tjscan.laser.simulated import SimulatedLaser
from tjscan.robot.arm import Arm
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.motion import MotionLimits
from tjscan.robot.simulated import SimulatedArm
from tjscan.robot.ur.arm import UrArm
from tjscan.robot.ur.settings import UrSettings
from tjscan.scanning.section import View

LASER_STREAM: Final = 1
PROBE_STREAM: Final = 2
"""Keep random numbers of laser and probe apart from the arm's, which has the bare seed."""


@dataclass(frozen=True, slots=True)
class Flange:
    """What a simulated laser on an arm's hand needs to know of it.

    Parameters
    ----------
    T_b_f : callable
        Gives where the flange truly is, shape (4, 4).
    time : callable
        Gives the seconds on the arm's clock.
    """

    T_b_f: Callable[[], Array]
    time: Callable[[], float]


def simulated_laser(
    laser: LaserTable,
    simulation: SimulationTable,
    flange: Flange,
    T_f_s: Array,
    surface: Surface,
    T_b_j: Array,
) -> SimulatedLaser:
    """A laser on an arm's hand, before a surface whose frame j stands in b."""
    T_j_b = inverse(T_b_j)
    T_f_s = T_f_s if simulation.T_f_s_mm is None else rows_to_pose(simulation.T_f_s_mm)
    return SimulatedLaser(
        surface,
        # Where the laser truly is, not where the arm believes it to be.
        pose=lambda: T_j_b @ flange.T_b_f() @ T_f_s,
        model=laser_model(laser, simulation.laser),
        rng=np.random.default_rng([simulation.seed, LASER_STREAM]),
        clock=flange.time,
    )


def arm_of(
    table: ArmTable, simulation: SimulationTable, left: View | None = None
) -> tuple[Arm, Flange]:
    """The arm by its driver, and where a simulated laser finds its flange."""
    with naming(key="arm.model"):
        kinematics = Kinematics.load(table.model)
    limits = MotionLimits(
        tcp_speed=1e-3 * table.speed_mm_s, tcp_acceleration=1e-3 * table.acceleration_mm_s2
    )
    if table.ur is not None and table.driver == "ur":
        real = UrArm(kinematics, _ur_settings(table.ur), limits)
        # Nobody knows the truth about a real arm: what it says has to do.
        return real, Flange(lambda: real.state().T_b_f, lambda: real.state().time)
    arm = _simulated_arm(kinematics, limits, simulation, left)
    return arm, Flange(lambda: arm.true_T_b_f, lambda: arm.state().time)


def _ur_settings(table: UrTable) -> UrSettings:
    x, y, z = table.payload_centre_mm
    return UrSettings(
        table.host,
        payload=table.payload_kg,
        centre_of_gravity=(1e-3 * x, 1e-3 * y, 1e-3 * z),
        position_tolerance=1e-3 * table.position_tolerance_mm,
        rotation_tolerance=radians(table.rotation_tolerance_deg),
        connect_limit=table.connect_s,
        silence_limit=table.silence_s,
    )


def _simulated_arm(
    kinematics: Kinematics, limits: MotionLimits, simulation: SimulationTable, left: View | None
) -> SimulatedArm:
    with naming(key="simulation.arm.home_deg"):
        return SimulatedArm(
            kinematics,
            np.radians(simulation.arm.home_deg) if left is None else left.q,
            limits=limits,
            repeatability=1e-3 * simulation.arm.repeatability_mm,
            angular_repeatability=float(np.radians(simulation.arm.repeatability_deg)),
            seed=simulation.seed,
            realtime=simulation.arm.realtime,
            time=0.0 if left is None else left.time,
        )


def laser_model(laser: LaserTable, faults: SimulatedLaserTable) -> LaserModel:
    """The sensor and its faults in metres; without occlusion the detector sits on the emitter."""
    model = LaserModel(
        columns=laser.points,
        near=1e-3 * laser.near_mm,
        far=1e-3 * laser.far_mm,
        noise=1e-3 * faults.noise_mm,
        noise_correlation=faults.noise_correlation_points,
        bias=1e-3 * faults.bias_mm,
        dropout=faults.dropout,
        missing=faults.missing,
        ghosts=faults.ghosts,
        flyers=faults.flyers,
        strays=faults.strays,
        interreflection=1e-3 * faults.interreflection_mm,
        step=1e-3 * faults.resolution_mm,
    )
    if faults.occlusion:
        return model
    return replace(model, detector_y=0.0, detector_z=model.emitter_z)
