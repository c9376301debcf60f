"""From a job to its cell: the arm, its clear paths, the laser, and its pose on the flange."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from pathlib import Path

from tjscan.calibration.file import read_calibration
from tjscan.core.config import add_file_to_errors
from tjscan.core.devices import DriverKind, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, inverse_pose
from tjscan.core.units import pose_from_rows_mm
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
from tjscan.robot.collision import CollisionModel, check_ignored_links
from tjscan.robot.collision_checked import CollisionCheckedArm
from tjscan.robot.deviations import CorrectedArm, deviate_joint_frames
from tjscan.robot.drivers import ARM_DRIVERS, ArmDriverInputs
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits
from tjscan.robot.settings import Solid, SolidSettings
from tjscan.scanning.recording import read_views


def kinematics_of_job(job: CellJob) -> Kinematics:
    """Kinematics of the arm's model; ConfigurationError if the model is unknown."""
    with add_file_to_errors(key="arm.model"):
        return Kinematics.load(job.arm.model)


def motion_limits_of_job(job: CellJob) -> MotionLimits:
    """How fast a job's arm may go, in single moves and along paths that grow."""
    arm = job.arm
    return MotionLimits(tcp_speed=arm.speed, tcp_acceleration=arm.acceleration, shaper=arm.shaper)


def clear_path_planner_of_job(job: CellJob, deviations: Array | None = None) -> ClearPathPlanner:
    """Planner that keeps a job's arm clear of its surroundings, whichever driver moves it.

    Parameters
    ----------
    job : CellJob
        The job.
    deviations : ndarray, shape (joints, 6), optional
        Of the arm's joints from its model.

    Raises
    ------
    ConfigurationError
        If the arm's model is unknown or its geometry can't be read, or an ignored link is unknown.
    """
    table = job.clearance
    kinematics = kinematics_of_job(job)
    if deviations is not None:
        kinematics = deviate_joint_frames(kinematics, deviations)
    with add_file_to_errors(key="clearance.ignore"):
        check_ignored_links(kinematics, table.ignore)
    with add_file_to_errors(key="arm.model"):
        model = collision_model_of_job(job, kinematics, table.tool)
    return ClearPathPlanner(kinematics, model, table)


def collision_model_of_job(
    job: CellJob, arm: Kinematics, tool: Iterable[SolidSettings], T_b_w: Array | None = None
) -> CollisionModel:
    """Make the model of what a job's arm may touch: itself, and the solids about it.

    Parameters
    ----------
    job : CellJob
        The job, of one station if it has any.
    arm : Kinematics
        Of its arm.
    tool : iterable of SolidSettings
        Solids that the flange carries.
    T_b_w : ndarray, shape (4, 4), optional
        As of `solids_in_base`.
    """
    table, solids, carried = job.clearance, solids_in_base(job, T_b_w), [one.solid for one in tool]
    own, ignored = table.self_collision, table.ignore
    return CollisionModel(arm, solids, carried, self_collision=own, ignored=ignored)


def solids_in_base(job: CellJob, T_b_w: Array | None = None) -> tuple[Solid, ...]:
    """Solids about a job's arm, with their poses in frame b.

    Parameters
    ----------
    job : CellJob
        The job, of one station if it has any.
    T_b_w : ndarray, shape (4, 4), optional
        Pose of the workpiece's frame; the one in the job if left out.
    """
    T_b_w = inverse_pose(job.T_w_b) if T_b_w is None else T_b_w
    return tuple(
        one.solid if one.frame == "b" else replace(one.solid, T=T_b_w @ one.solid.T)
        for one in job.clearance.solid
    )


@dataclass(frozen=True, slots=True, eq=False)
class SensorMount:
    """Pose of the laser on the flange, and the calibration file it comes from.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        Pose of the laser in the flange frame.
    file : Path or None
        The calibration it comes from; None if the job itself holds it.
    deviations : ndarray, shape (joints, 6), or None
        Of the arm's joints from its model, where they were calibrated with it.
    covariance : ndarray, shape (6, 6) or (6 + 6 joints, 6 + 6 joints), or None
        Of `T_f_s`, translation and small rotation in axes of f, and of the deviations, if any;
        SI. None if it is not known.
    by_laser : ndarray, shape (6, m) or (6 + 6 joints, m), or None
        What of it comes from m draws of the laser's deviation, see
        `LaserDeviation.displacements_at`; none where that was not calibrated with.
    linearity : float
        Largest deviation of that laser, metres.
    """

    T_f_s: Array
    file: Path | None = None
    deviations: Array | None = None
    covariance: Array | None = None
    by_laser: Array | None = None
    linearity: float = 0.0


def sensor_mount_of_job(job: CellJob, job_file: Path) -> SensorMount:
    """Pose of the laser on the flange, as a job states it or as its calibration file does.

    Parameters
    ----------
    job : CellJob
        The job.
    job_file : Path
        The file that it was read from.

    Raises
    ------
    ConfigurationError
        If the calibration can't be read, or holds for another arm or laser.
    """
    if (T_f_s := job.calibration.T_f_s) is not None:
        return SensorMount(T_f_s, covariance=job.calibration.covariance)
    file = job_file.parent / str(job.calibration.file)
    # A recording does not name the laser that made it, unless the job does.
    laser = job.laser.id if job.laser.driver_kind is DriverKind.REPLAYED else job.laser.device_id
    found = read_calibration(file, arm=job.arm.device_id, laser=laser)
    by_laser, linearity = None, 0.0
    if (response := found.laser_response) is not None:
        by_laser, linearity = response.response_si, 1e-3 * response.linearity_mm
    if (arm := found.kinematics) is None:
        return SensorMount(found.T_f_s, file, None, found.covariance_si, by_laser, linearity)
    if arm.model != (name := kinematics_of_job(job).name):
        raise ConfigurationError(
            f"holds the kinematics of a {arm.model!r}, but this cell has a {name!r}: calibrate "
            "this arm",
            file=file,
            key="kinematics.model",
        )
    return SensorMount(found.T_f_s, file, arm.deviations_si, arm.covariance_si, by_laser, linearity)


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


def make_cell(
    job: CellJob,
    mount: SensorMount,
    scene: Callable[[], SimulatedScene],
    left: ArmState | None = None,
) -> Cell:
    """Make the cell that a job describes, by its drivers; entering it connects the devices.

    Parameters
    ----------
    job : CellJob
        The job, of one station if it has any.
    mount : SensorMount
        Estimated pose of the laser on the flange; the arm's poses are corrected by the deviations
        that were calibrated with it, if any.
    scene : callable
        Gives what a simulated laser looks at; called for such a laser alone. See `joint_scene`.
    left : ArmState, optional
        State of the arm when a scan was interrupted: a simulated arm starts from it.

    Raises
    ------
    ConfigurationError
        If a driver or the arm's model is unknown, a package is missing that a driver needs, or
        the job lacks what it needs.
    """
    clearance, simulation = clear_path_planner_of_job(job, mount.deviations), job.simulation
    model, T_f_s = kinematics_of_job(job), mount.T_f_s
    recording = cache(partial(_read_recording, job.laser))
    arm_driver = ARM_DRIVERS.load(job.arm.driver)
    device: Arm = job.arm.make_device(
        ArmDriverInputs(
            model,
            motion_limits_of_job(job),
            seed=0 if simulation is None else simulation.seed,
            simulation=None if simulation is None else simulation.arm,
            left=left,
            recording=lambda: recording()[:2],
        )
    )
    arm = device
    if arm_driver.kind is not DriverKind.REPLAYED:
        if mount.deviations is not None:
            arm = CorrectedArm(arm, model, clearance.kinematics)
        arm = CollisionCheckedArm(arm, clearance, T_f_s, lifts=job.clearance.lifts)
    true_flange = partial(arm_driver.truth, device)
    pass_time = partial(arm_driver.pass_time, device)
    flange = LaserFlange.of_arm(true_flange, device.state, pass_time)
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
    flange, scene = LaserFlange(T_b_f, T_b_f, time), partial(joint_scene, job, joint)
    inputs = _laser_driver_inputs(
        job, flange, T_f_s, scene, lambda: _read_recording(job.laser)[::2]
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
    T_b_f, times = [view.T_b_f for view in views], [view.time for view in views]
    distance, angle = table.replay_tolerance, table.replay_angle
    poses = RecordedPoses(T_b_f, times, distance=distance, angle=angle)
    states = tuple(ArmState(view.q, view.T_b_f, view.time) for view in views)
    return poses, states, tuple(view.profile for view in views)


def joint_scene(job: ScanJob, joint: JointDefinition | None) -> SimulatedScene:
    """The joint of a job at its true pose; ConfigurationError if the job has none."""
    if job.joint is None or joint is None:
        raise ConfigurationError("a simulated laser needs a [joint] table to look at", key="joint")
    return SimulatedScene(joint_surface(joint), inverse_pose(job.T_w_b_true) @ job.joint.T_w_j)


@lru_cache(maxsize=2)
def joint_surface(joint: JointDefinition) -> RaycastSurface:
    """What light hits of a joint; kept, since many cells in a row may look at the same one."""
    mesh = build_joint_mesh(joint)
    return RaycastSurface(mesh.vertices, mesh.triangles, make_relief_height_function(joint))
