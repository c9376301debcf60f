"""From a job to the arm, the laser and the pose of the laser on the arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from pathlib import Path

from tjscan.core.config import add_file_to_errors
from tjscan.core.devices import DriverKind, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, inverse_pose
from tjscan.core.units import pose_from_rows_mm
from tjscan.job.arm import clear_path_planner_of_job, kinematics_of_job
from tjscan.job.devices import DeviceGroup, LaserSettings
from tjscan.job.files import CellJob, ScanJob
from tjscan.joint.definition import JointDefinition
from tjscan.joint.mesh import build_joint_mesh
from tjscan.joint.relief import make_relief_height_function
from tjscan.laser.drivers import LASER_DRIVERS, LaserDriverInputs, LaserFlange, SimulatedScene
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.optics import RaycastSurface
from tjscan.laser.profile import Profile
from tjscan.laser.replay import RecordedPoses
from tjscan.robot.arm import Arm, ArmState
from tjscan.robot.clearance import ClearPathPlanner
from tjscan.robot.collision_checked import CollisionCheckedArm
from tjscan.robot.deviations import CorrectedArm
from tjscan.robot.drivers import ARM_DRIVERS, ArmDriverInputs
from tjscan.robot.path import MotionLimits
from tjscan.scanning.recording import read_views


@dataclass(frozen=True, slots=True, eq=False)
class Cell(DeviceGroup):
    """An arm, the laser on its flange, and the pose of the laser there; connects both devices.

    Parameters
    ----------
    arm : Arm
        The arm.
    laser : LineLaser
        The laser.
    T_f_s : ndarray, shape (4, 4)
        Pose of the laser in the flange frame.
    clearance : ClearPathPlanner
        Keeps the arm's paths clear; scanned surfaces are added to it.
    true_flange : callable
        Returns the true pose of the flange, shape (4, 4), for other simulations; see
        `ArmDriverFactory`.
    """

    arm: Arm
    laser: LineLaser
    T_f_s: Array
    clearance: ClearPathPlanner
    true_flange: Callable[[], Array]

    @property
    def devices(self) -> tuple[Arm, LineLaser]:
        """The arm and the laser."""
        return self.arm, self.laser


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
        Pose of the laser on the flange, see `sensor_mount_of_job`.
    joint : JointDefinition, optional
        What a simulated laser looks at.
    left : ArmState, optional
        State of the arm when a scan was interrupted.
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
        Estimated pose of the laser on the flange.
    scene : callable
        Gives what a simulated laser looks at; called for such a laser alone.
    left : ArmState, optional
        State of the arm when a scan was interrupted: a simulated arm starts from it.
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
    recording = cache(partial(_read_recording, job.laser))
    arm_driver = ARM_DRIVERS.load(job.arm.driver)
    device: Arm = job.arm.make_device(
        ArmDriverInputs(
            model,
            MotionLimits(tcp_speed=job.arm.speed, tcp_acceleration=job.arm.acceleration),
            seed=0 if simulation is None else simulation.seed,
            simulation=None if simulation is None else simulation.arm,
            left=left,
            recording=lambda: recording()[:2],
        )
    )
    arm = device
    if arm_driver.kind is not DriverKind.REPLAYED:
        if deviations is not None:
            arm = CorrectedArm(arm, model, clearance.kinematics)
        arm = CollisionCheckedArm(arm, clearance, T_f_s, lifts=job.clearance.lifts)
    true_flange = partial(arm_driver.truth, device)
    flange = LaserFlange.of_arm(true_flange, device.state)
    inputs = _laser_driver_inputs(job, flange, T_f_s, scene, lambda: recording()[::2])
    return Cell(arm, job.laser.make_device(inputs), T_f_s, clearance, true_flange)


def make_simulated_laser(
    job: ScanJob,
    T_f_s: Array,
    joint: JointDefinition | None,
    T_b_f: Callable[[], Array],
    time: Callable[[], float],
) -> LineLaser:
    """Make the simulated laser of a job on a flange that another program moves.

    Parameters
    ----------
    job : ScanJob
        The job, of one station if it has any.
    T_f_s : ndarray, shape (4, 4)
        Estimated pose of the laser on the flange.
    joint : JointDefinition
        What it looks at.
    T_b_f : callable
        Returns the pose of the flange, shape (4, 4).
    time : callable
        Returns the seconds on the clock of the cell.

    Raises
    ------
    ConfigurationError
        If the job has no [simulation] or no joint.
    """
    inputs = _laser_driver_inputs(
        job,
        LaserFlange(T_b_f, T_b_f, time),
        T_f_s,
        partial(_joint_scene, job, joint),
        lambda: _read_recording(job.laser)[::2],
    )
    laser: LineLaser = LASER_DRIVERS.load("simulated").make(inputs, NoSettings())
    return laser


def _laser_driver_inputs(
    job: CellJob,
    flange: LaserFlange,
    T_f_s: Array,
    scene: Callable[[], SimulatedScene],
    recording: Callable[[], tuple[RecordedPoses, tuple[Profile, ...]]],
) -> LaserDriverInputs:
    """What a laser is made from, at its true pose on the flange if the job states that."""
    simulation = job.simulation
    rows = None if simulation is None else simulation.T_f_s_mm
    true_pose = T_f_s if rows is None else pose_from_rows_mm(rows)
    seed = None if simulation is None else simulation.seed
    return LaserDriverInputs(job.laser_model, flange, true_pose, scene, seed, recording)


def _read_recording(
    table: LaserSettings,
) -> tuple[RecordedPoses, tuple[ArmState, ...], tuple[Profile, ...]]:
    """Recorded poses of the flange, states of the arm and profiles, shared by replayed devices."""
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
    """The joint of a job at its true pose."""
    if job.joint is None or joint is None:
        raise ConfigurationError("a simulated laser needs a [joint] table to look at", key="joint")
    return SimulatedScene(_joint_surface(joint), inverse_pose(job.T_w_b_true) @ job.joint.T_w_j)


@lru_cache(maxsize=2)
def _joint_surface(joint: JointDefinition) -> RaycastSurface:
    """What light hits of a joint; kept, since many cells in a row may look at the same one."""
    mesh = build_joint_mesh(joint)
    return RaycastSurface(mesh.vertices, mesh.triangles, make_relief_height_function(joint))
