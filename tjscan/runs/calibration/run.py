"""Run a calibration, check it before, or make it from recorded profiles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final, NoReturn

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from tjscan.calibration.arm.calibrate import ArmGeometryDeviation, as_hand_eye_calibration
from tjscan.calibration.arm.wizard import ArmWizard, PosturePlan, plan_postures
from tjscan.calibration.closed_form import plane_through_point
from tjscan.calibration.file import (
    BasisEntry,
    SavedCalibration,
    UncertaintyAfterLinesEntry,
    views_of_poses,
    write_calibration,
)
from tjscan.calibration.recorded import calibrate_recorded_sets
from tjscan.calibration.result import HandEyeCalibration, HandEyeUncertainty
from tjscan.calibration.targets.plane import fit_plane
from tjscan.calibration.targets.target import PosedProfile
from tjscan.calibration.to_file import to_calibration_file
from tjscan.calibration.wizard.logbook import (
    CALIBRATION_RECORDING_KIND,
    LaserLineTaken,
    Logbook,
    MeasurementsSoFar,
)
from tjscan.calibration.wizard.operator import JoggedProbe, Operator, Question, TouchProbe
from tjscan.calibration.wizard.session import BoardRectangle, CalibrationPlan
from tjscan.calibration.wizard.simulated import SimulatedTouchProbe
from tjscan.calibration.wizard.wizard import CalibrationWizard, can_reach_and_return
from tjscan.core.devices import DriverKind
from tjscan.core.errors import CalibrationRefused, ConfigurationError, PoseUnreachable
from tjscan.core.files import lock_and_clean_directory
from tjscan.core.frames import Array
from tjscan.core.manifest import check_files_unaltered
from tjscan.core.provenance import Provenance
from tjscan.core.units import pose_to_rows_mm
from tjscan.job.cell import Cell, SensorMount, kinematics_of_job, make_cell, sensor_mount_of_job
from tjscan.job.devices import CalibrationSettings
from tjscan.job.files import CalibrationJob, RecordedJob, read_calibration_job
from tjscan.job.surroundings import BallSettings, SimulatedBoardSettings
from tjscan.laser.deviation import LaserDeviation
from tjscan.laser.drivers import SimulatedScene
from tjscan.laser.optics import RaycastSurface
from tjscan.laser.profile import Profile
from tjscan.result.directory import CALIBRATION_FILE, JOB_FILE, job_label_of_run
from tjscan.robot.arm import Arm
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.run import make_run_directory

BALL_SUBDIVISIONS: Final = 6
"""Of an icosahedron: its faces are then within 2 µm of a ball of 40 mm."""


def _calibrate_on_ball(
    job: CalibrationJob, ball: BallSettings, wizard: CalibrationWizard
) -> tuple[HandEyeCalibration, BasisEntry]:
    """Look at a ball from many postures, and calibrate arm and sensor together.

    Lines on the board, which the wizard takes first, show how the sensor sits; raises as
    `CalibrationWizard.take_lines` and `ArmWizard.run` do.
    """
    T_f_s = wizard.take_lines(*wizard.touch_board()).T_f_s
    task, kinematics, logbook = wizard.task, kinematics_of_job(job), wizard.logbook
    limits = ball.noise, ball.tolerance, ball.poses, ball.held_out, task.laser
    plan = PosturePlan(np.array(ball.position), ball.radius, T_f_s, task.window, *limits)
    views, devices = plan_postures(plan, kinematics), (wizard.arm, wizard.laser, wizard.operator)
    q = wizard.arm.state().q
    found, arcs = ArmWizard(plan, views, kinematics, *devices, logbook, q).run()
    result = as_hand_eye_calibration(found, [arc.name for arc in arcs], kinematics.name)
    shots = [taken.posed_profile for taken in logbook.measured.arm_poses.values()]
    seen = {shot.name: shot.T_b_f for shot in shots if len(shot.profile)}
    radius = "" if result.radius is None else f"radius found {1e3 * result.radius:.3f} mm, "
    return result, BasisEntry(
        target=f"ball, {radius}about {1e3 * ball.radius:g} mm stated",
        left_out=tuple(f"{s.name} was not reached" for s in shots if not len(s.profile)),
        caveats=result.caveats,
        views=views_of_poses(seen, result.T_f_s),
    )


def _basis_on_touched_board(wizard: CalibrationWizard, result: HandEyeCalibration) -> BasisEntry:
    """What a calibration on a touched board rests on; raises as `fit_plane` does."""
    task, measured = wizard.task, wizard.measurements
    target, _ = task.fit_board(measured)
    off = 1e3 * float(np.sqrt(np.mean(target.residuals**2)))
    poses = {shot.name: shot.T_b_f for shot in measured.line_profiles}
    shrinking = []
    for count in range(1, len(measured.line_profiles) + 1):
        first = replace(measured, line_profiles=measured.line_profiles[:count])
        so_far = task.progress(first, target).result
        if so_far is not None:  # the first lines give no result
            mm = 1e3 * so_far.uncertainty.position
            degrees = float(np.degrees(so_far.uncertainty.rotation))
            sigmas = {"sigma_position_mm": mm, "sigma_rotation_deg": degrees}
            shrinking.append(UncertaintyAfterLinesEntry(lines=count, **sigmas))
    return BasisEntry(
        target=f"board touched at {len(target.residuals)} places, {off:.3f} mm RMS off a plane",
        left_out=tuple(f"a pose was passed over: {one.reason}" for one in measured.skipped_poses),
        caveats=result.caveats,
        views=views_of_poses(poses, result.T_f_s),
        shrinking=tuple(shrinking),
    )


BOARD_THICKNESS: Final = 5e-3
"""Metres, of the simulated board."""

PROBE_RANDOM_STREAM: Final = 2
"""Keeps the random numbers of the probe apart from the arm's and the laser's."""


def start_calibration(
    job: CalibrationJob, job_file: Path, directory: Path, operator: Operator, *, arm: bool = False
) -> SavedCalibration:
    """Calibrate as a job states, in a new directory that can be resumed.

    Parameters
    ----------
    job : CalibrationJob
        The job.
    job_file : Path
        The file that it was read from.
    directory : Path
        To make.
    operator : Operator
        Is asked before every move.
    arm : bool
        Whether the arm's kinematics are calibrated with the sensor, on the job's ball.

    Raises
    ------
    TjscanError
        If the job is wrong, a device fails or the result can't be trusted; what was measured
        until then is kept.
    """
    if (directory / f"{CALIBRATION_RECORDING_KIND}.mcap").exists():
        reason = f"holds a calibration already; go on with it: --resume {directory}"
        raise ConfigurationError(reason, file=directory)
    if arm and job.ball is None:
        raise ConfigurationError("--arm looks at a ball: the job needs a table [ball]", key="ball")
    # The directory keeps the guess itself: the file it may come from is not its own result.
    guess = CalibrationSettings(T_f_s_mm=pose_to_rows_mm(sensor_mount_of_job(job, job_file).T_f_s))
    ball = job.ball if arm else None
    alone = job.model_copy(update={"calibration": guess, "joint": None, "scan": None, "ball": ball})
    make_run_directory(directory, alone, job_file)
    return resume_calibration(directory, operator)


def resume_calibration(directory: Path, operator: Operator) -> SavedCalibration:
    """Resume an interrupted calibration; raises as `start_calibration` does."""
    check_files_unaltered(directory / JOB_FILE)
    job = read_calibration_job(directory / JOB_FILE)
    file, drivers = directory / CALIBRATION_FILE, {job.arm.driver_kind, job.laser.driver_kind}
    if file.exists():
        raise ConfigurationError("is finished already; there is nothing to resume", file=directory)
    if not operator.present and drivers != {DriverKind.SIMULATED}:
        raise ConfigurationError("a real arm moves only while a person watches: not unattended")
    T_f_s = sensor_mount_of_job(job, directory / JOB_FILE).T_f_s
    cell, probe = make_calibration_cell(job, T_f_s)
    with (
        lock_and_clean_directory(directory),
        Logbook(directory, T_f_s, operator.show_entry) as logbook,
        cell,
    ):
        task = calibration_plan_of_job(job, T_f_s)
        wizard = CalibrationWizard(task, cell.arm, cell.laser, probe, operator, logbook)
        if job.ball is None:
            (result, verification), noise = wizard.run(), job.board.noise
            basis = _basis_on_touched_board(wizard, result)
        else:
            verification, noise = None, job.ball.noise
            result, basis = _calibrate_on_ball(job, job.ball, wizard)
        found = to_calibration_file(
            result,
            noise,
            arm=job.arm.device_id,
            laser=job.laser.device_id,
            date=logbook.measured.started_at,
            verification=verification,
            linearity=0.0 if task.laser is None else task.laser.largest,
            basis=basis,
        )
    if not operator.confirm(Question(f"Save it as {file}?", True, yes="Finish", no="Skip")):
        raise CalibrationRefused("not saved", f"what was measured stays in {directory}")
    provenance = Provenance.for_file_written_now(job_label_of_run(directory), "f")
    write_calibration(file, found, provenance)
    return SavedCalibration(file, found, result.caveats)


def make_calibration_cell(job: CalibrationJob, T_f_s: Array) -> tuple[Cell, TouchProbe]:
    """Make the cell of a calibration, and the probe that touches its board.

    With a real laser a person jogs the arm onto the board; a simulated one looks at a simulated
    board, which the arm touches by itself.

    Parameters
    ----------
    job : CalibrationJob
        The job.
    T_f_s : ndarray, shape (4, 4)
        Rough pose of the laser.

    Raises
    ------
    ConfigurationError
        As `make_cell` does.
    """
    simulation, board, mount = job.simulation, job.board, SensorMount(T_f_s)
    if job.laser.driver_kind is DriverKind.REPLAYED:
        raise ConfigurationError(
            "a calibration touches its board: recorded profiles go into tables [[recorded]]",
            key="laser.driver",
        )
    if job.laser.driver_kind is DriverKind.REAL:
        cell = make_cell(job, mount, _refuse_board_without_simulation)
        return cell, JoggedProbe(cell.arm)
    if simulation is None:
        _refuse_board_without_simulation()
    as_stated = SimulatedBoardSettings(position=board.position, euler_zyx=board.euler_zyx)
    truth = simulation.board or as_stated
    cell = make_cell(
        job, mount, lambda: SimulatedScene(_board_and_ball_surface(job, truth.T), np.eye(4))
    )
    plane = plane_through_point(truth.T[:3, 3], truth.T[:3, 2])
    return cell, SimulatedTouchProbe(
        cell.arm,
        np.array(board.probe_tip),
        board.T,
        plane,
        sigma=truth.touch,
        approach=board.approach,
        rng=np.random.default_rng([simulation.seed, PROBE_RANDOM_STREAM]),
        true_flange=cell.true_flange,
    )


def _refuse_board_without_simulation() -> NoReturn:
    raise ConfigurationError("a simulated board needs the table [simulation]")


def _board_and_ball_surface(job: CalibrationJob, T_b_board: Array) -> RaycastSurface:
    """The board, whose upper face is the plane z = 0 of its frame, and the ball; frame b."""
    plate = trimesh.creation.box((*job.board.size, BOARD_THICKNESS))
    plate.apply_translation((0.0, 0.0, -0.5 * BOARD_THICKNESS))
    plate.apply_transform(T_b_board)
    bodies = [plate]
    if job.ball is not None:
        ball = (job.simulation and job.simulation.ball) or job.ball
        bodies.append(ball_mesh(ball.radius, ball.position))
    whole = trimesh.util.concatenate(bodies)
    return RaycastSurface(whole.vertices, whole.faces)


def ball_mesh(radius: float, centre: ArrayLike) -> trimesh.Trimesh:
    """A ball, metres."""
    sphere = trimesh.creation.icosphere(subdivisions=BALL_SUBDIVISIONS, radius=radius)
    sphere.apply_translation(centre)
    return sphere


def calibration_plan_of_job(job: CalibrationJob, T_f_s: Array) -> CalibrationPlan:
    """Plan of a calibration: what its job states of board, laser and numbers of lines.

    Parameters
    ----------
    job : CalibrationJob
        The job.
    T_f_s : ndarray, shape (4, 4)
        Rough pose of the laser.
    """
    board = job.board
    # That other lasers of this class open their fan as the simulated one is an assumption.
    window = job.laser_model.measuring_range
    largest, _ = job.laser.uncertainty.stated_linearity
    deviation = None  # if the laser is stated to be exact
    if largest:
        deviation = LaserDeviation.for_window(largest, window)
    board_f = board.T, 0.5 * np.array(board.size), np.array(board.probe_tip)
    measured = board.noise, board.touches, board.lines
    moves = ArmGeometryDeviation(kinematics_of_job(job)).flange_motion
    return CalibrationPlan(*board_f, T_f_s, window, *measured, moves, deviation)


UNNAMED_DEVICE: Final = "unnamed"
"""Name in the file of an arm or a laser without an id; no scan takes the file."""


def calibrate_recorded_job(
    job: RecordedJob, job_file: Path, directory: Path, report: Callable[[str], None]
) -> SavedCalibration:
    """Calibrate from the recorded profiles of a job, and write ``calibration.toml``.

    Parameters
    ----------
    job : RecordedJob
        The job.
    job_file : Path
        Its file, from whose folder the paths of recorded files start.
    directory : Path
        To make, once there is a result.
    report : callable
        Receives messages about files, left-out profiles and results.

    Raises
    ------
    ConfigurationError
        If a file is missing or wrong, or the directory holds a calibration already.
    CalibrationRefused
        If the result could not be trusted.
    """
    file = directory / CALIBRATION_FILE
    if file.exists():
        raise ConfigurationError("is there already; choose another --out", file=file)
    result, basis = calibrate_recorded_sets(
        job.recorded,
        job.noise,
        job_file.parent,
        report,
        sensor_is_fixed=job.solve.fixed_sensor,
        kinematics=Kinematics.load(job.arm.model) if job.solve.calibrate_arm else None,
    )
    found = to_calibration_file(
        result,
        job.noise,
        arm=job.arm.id or UNNAMED_DEVICE,
        laser=job.laser.id or UNNAMED_DEVICE,
        date=datetime.now(UTC).replace(microsecond=0),
        basis=basis,
    )
    frame = "f" if found.T_b_s_mm is None else "b"
    write_calibration(file, found, Provenance.for_file_written_now(job_file.name, frame))
    return SavedCalibration(file, found, result.caveats)


EMPTY_PLANNED_PROFILE: Final = Profile(np.empty(0), np.empty(0))
"""Of a line that is planned only."""


def check_calibration_job(job: CalibrationJob, job_file: Path) -> HandEyeUncertainty:
    """Plan all lines of a calibration on the board as the job places it; move nothing.

    Parameters
    ----------
    job : CalibrationJob
        The job; its devices are connected.
    job_file : Path
        The file that it was read from.

    Returns
    -------
    HandEyeUncertainty
        That is to be expected of the calibration.

    Raises
    ------
    ConfigurationError
        If the job, or a file that it names, is wrong.
    CalibrationRefused
        If the arm can't get over the board, or too few poses that it reaches see it.
    """
    T_f_s = sensor_mount_of_job(job, job_file).T_f_s
    task = calibration_plan_of_job(job, T_f_s)
    cell, _ = make_calibration_cell(job, T_f_s)
    with cell:
        return _predict_final_uncertainty(task, cell.arm, _find_start_pose(task, cell.arm))


def _find_start_pose(task: CalibrationPlan, arm: Arm) -> Array:
    """Flange pose square over the board that the arm gets to."""
    reason = ""
    for T_b_f in task.start_poses(arm.state().T_b_f):
        try:
            arm.check_moves(T_b_f)
        except PoseUnreachable as error:
            reason = str(error)
        else:
            return T_b_f
    raise CalibrationRefused("the arm can't get square over the board", reason)


def _predict_final_uncertainty(task: CalibrationPlan, arm: Arm, ready: Array) -> HandEyeUncertainty:
    """Plan lines one after the other, as the wizard would if each were as expected."""
    touched, outside = task.touch_points, task.T_b_board[:3, 3] + task.T_b_board[:3, 2]
    target = fit_plane(touched, task.noise.touch, outside, geometry=task.noise.geometry)
    board = BoardRectangle.through_touched_points(touched, target)
    measured = MeasurementsSoFar(datetime.now(UTC), {})
    expected = task.line_predictor(task.T_f_s, target).uncertainty(np.empty((0, 4, 4)))
    reaches = partial(can_reach_and_return, arm, ready)
    for number in range(1, task.lines + 1):
        there = task.suggest_line_pose(measured, target, board, None, reaches)
        shot = PosedProfile(f"line {number}", there.T_b_f, EMPTY_PLANNED_PROFILE)
        measured, expected = measured.with_entry(LaserLineTaken(shot, False)), there.after
    return expected
