"""From a job to the arm, the laser and where the one sits on the other."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.devices import DriverKind, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, inverse_pose
from tjscan.core.units import pose_from_rows_mm
from tjscan.job import CellJob, LaserSettings, ScanJob
from tjscan.job.arm import clear_path_planner_of_job, kinematics_of_job
from tjscan.joint.definition import JointDefinition
from tjscan.joint.mesh import build_joint_mesh
from tjscan.joint.relief import make_relief_height_function
from tjscan.laser.drivers import LASER_DRIVERS, LaserDriverInputs, LaserFlange, SimulatedScene
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.model import LaserModel
from tjscan.laser.optics import RaycastSurface
from tjscan.laser.profile import Profile
from tjscan.laser.replay import RecordedPoses
from tjscan.robot.arm import Arm, ArmState
from tjscan.robot.clearance import ClearPathPlanner
from tjscan.robot.collision_checked import CollisionCheckedArm
from tjscan.robot.corrected import CorrectedArm
from tjscan.robot.drivers import ARMS, ArmDriverInputs
from tjscan.robot.motion import MotionLimits
from tjscan.scanning.reader import read_views


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """An arm, the laser on its hand, and where the laser sits; a context manager for both devices.

    Parameters
    ----------
    arm : Arm
        The arm.
    laser : LineLaser
        The laser.
    T_f_s : ndarray, shape (4, 4)
        Pose of the laser in the flange frame.
    clearance : ClearPathPlanner
        What the arm's paths keep; scanned surfaces are added to it.
    true_flange : callable
        Gives where the flange truly is, shape (4, 4), for what else is simulated; see
        `ArmDriverFactory`.
    """

    arm: Arm
    laser: LineLaser
    T_f_s: Array
    clearance: ClearPathPlanner
    true_flange: Callable[[], Array]

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(self.arm)
            stack.enter_context(self.laser)
            stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self.laser.__exit__(kind, error, trace)
        finally:
            self.arm.__exit__(kind, error, trace)


def make_scan_cell(
    job: ScanJob,
    T_f_s: Array,
    joint: JointDefinition | None,
    left: ArmState | None = None,
    deviations: Array | None = None,
) -> Cell:
    """Make the cell of a scan; see `make_cell`.

    Parameters
    ----------
    job : ScanJob
        The job.
    T_f_s : ndarray, shape (4, 4)
        Where the laser sits, see `sensor_mount_of_job`.
    joint : JointDefinition, optional
        What a simulated laser looks at.
    left : ArmState, optional
        Where an interrupted scan left the arm.
    deviations : ndarray, shape (joints, 6), optional
        Of the arm's joints, see `make_cell`.
    """
    return make_cell(job, T_f_s, partial(_joint_scene, job, joint), left, deviations)


def make_cell(
    job: CellJob,
    T_f_s: Array,
    scene: Callable[[], SimulatedScene],
    left: ArmState | None = None,
    deviations: Array | None = None,
) -> Cell:
    """Make the cell that a job describes, by its drivers; entering it connects the devices.

    Parameters
    ----------
    job : CellJob
        The job, of one station if it has any.
    T_f_s : ndarray, shape (4, 4)
        Where the laser is believed to sit on the flange.
    scene : callable
        Gives what a simulated laser looks at; called for such a laser alone.
    left : ArmState, optional
        Where an interrupted scan left the arm: a simulated one stands there again.
    deviations : ndarray, shape (joints, 6), optional
        Of the arm's joints from its model, as calibrated: its poses are corrected by them.

    Raises
    ------
    ConfigurationError
        If a driver or the arm's model is unknown, a package is missing that a driver needs, or
        the job lacks what it needs.
    """
    clearance, simulation = clear_path_planner_of_job(job, deviations), job.simulation
    model = kinematics_of_job(job)
    recording = cache(partial(_recording, job.laser))
    arm_driver, laser_driver = ARMS.load(job.arm.driver), LASER_DRIVERS.load(job.laser.driver)
    with ARMS.explain_missing_package(job.arm.driver):
        device = arm_driver.make(
            ArmDriverInputs(
                model,
                MotionLimits(tcp_speed=job.arm.speed, tcp_acceleration=job.arm.acceleration),
                seed=0 if simulation is None else simulation.seed,
                simulation=None if simulation is None else simulation.arm,
                left=left,
                recording=lambda: (recording()[0], recording()[1]),
            ),
            job.arm.driver_settings,
        )
    arm: Arm = device
    if arm_driver.kind is not DriverKind.REPLAYED:
        if deviations is not None:
            arm = CorrectedArm(arm, model, clearance.kinematics)
        arm = CollisionCheckedArm(arm, clearance, T_f_s, lifts=job.clearance.lifts)
    rows = None if simulation is None else simulation.T_f_s_mm
    true_flange = partial(arm_driver.truth, device)
    with LASER_DRIVERS.explain_missing_package(job.laser.driver):
        laser = laser_driver.make(
            LaserDriverInputs(
                laser_model_of_job(job),
                LaserFlange(
                    true_flange,
                    lambda: device.state().T_b_f,
                    lambda: device.state().time,
                ),
                T_f_s if rows is None else pose_from_rows_mm(rows),
                scene,
                seed=None if simulation is None else simulation.seed,
                recording=lambda: (recording()[0], recording()[2]),
            ),
            job.laser.driver_settings,
        )
    return Cell(arm, laser, T_f_s, clearance, true_flange)


def make_simulated_laser(
    job: ScanJob,
    T_f_s: Array,
    joint: JointDefinition | None,
    T_b_f: Callable[[], Array],
    time: Callable[[], float],
) -> LineLaser:
    """Make the simulated laser of a job on a flange that somebody else moves.

    Parameters
    ----------
    job : ScanJob
        The job, of one station if it has any.
    T_f_s : ndarray, shape (4, 4)
        Where the laser is believed to sit on the flange.
    joint : JointDefinition
        What it looks at.
    T_b_f : callable
        Gives where the flange is, shape (4, 4).
    time : callable
        Gives the seconds on the clock of the cell.

    Raises
    ------
    ConfigurationError
        If the job has no [simulation] or no joint.
    """
    simulation = job.simulation
    rows = None if simulation is None else simulation.T_f_s_mm
    laser: LineLaser = LASER_DRIVERS.load("simulated").make(
        LaserDriverInputs(
            laser_model_of_job(job),
            LaserFlange(T_b_f, T_b_f, time),
            T_f_s if rows is None else pose_from_rows_mm(rows),
            partial(_joint_scene, job, joint),
            seed=None if simulation is None else simulation.seed,
            recording=lambda: _recording(job.laser)[::2],
        ),
        NoSettings(),
    )
    return laser


def make_laser_alone(
    table: LaserSettings, model: LaserModel, time: Callable[[], float]
) -> LineLaser:
    """Make a real laser that nothing carries.

    Parameters
    ----------
    table : LaserSettings
        Which laser.
    model : LaserModel
        The window that the job states.
    time : callable
        Gives the seconds on the clock that its profiles are timed by.

    Raises
    ------
    ConfigurationError
        If it is not a real one, or a package is missing that its driver needs.
    """
    driver = LASER_DRIVERS.load(table.driver)
    if driver.kind is not DriverKind.REAL:
        raise ConfigurationError(f"{table.driver!r} is no real laser", key="laser.driver")
    with LASER_DRIVERS.explain_missing_package(table.driver):
        laser: LineLaser = driver.make(
            LaserDriverInputs(
                model,
                LaserFlange(_no_flange, _no_flange, time),
                np.eye(4),
                _no_scene,
                seed=None,
                recording=lambda: _recording(table)[::2],
            ),
            table.driver_settings,
        )
    return laser


def _no_flange() -> Array:
    raise ConfigurationError("the laser sits on no arm here", key="arm")


def _no_scene() -> SimulatedScene:
    raise ConfigurationError("there is nothing simulated to look at", key="simulation")


def _recording(
    table: LaserSettings,
) -> tuple[RecordedPoses, tuple[ArmState, ...], tuple[Profile, ...]]:
    """What replayed devices share: where the flange stood, the arm's states, the profiles."""
    with add_file_to_errors(key="laser.recording"):
        views = list(read_views(Path(table.recording or "")))
    poses = RecordedPoses(
        [view.T_b_f for view in views],
        [view.time for view in views],
        distance=table.replay_tolerance,
        angle=table.replay_angle,
    )
    states = tuple(ArmState(view.q, view.T_b_f, view.time) for view in views)
    return poses, states, tuple(view.profile for view in views)


def _joint_scene(job: ScanJob, joint: JointDefinition | None) -> SimulatedScene:
    """The joint of a job, where it truly stands."""
    if job.joint is None or joint is None:
        raise ConfigurationError("a simulated laser needs a [joint] table to look at", key="joint")
    return SimulatedScene(_surface(joint), inverse_pose(job.T_w_b_true) @ job.joint.T_w_j)


@lru_cache(maxsize=2)
def _surface(joint: JointDefinition) -> RaycastSurface:
    """What light hits of a joint; kept, since many cells in a row may look at the same one."""
    mesh = build_joint_mesh(joint)
    return RaycastSurface(mesh.vertices, mesh.triangles, make_relief_height_function(joint))


def laser_model_of_job(job: CellJob) -> LaserModel:
    """The laser that a job describes: the window of [laser], the faults of [simulation.laser]."""
    faults = LaserModel() if job.simulation is None else job.simulation.laser
    table = job.laser
    return replace(faults, columns=table.points, near=table.near, far=table.far)
