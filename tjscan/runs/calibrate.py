"""Run a calibration: from its job to a directory with all that was measured, and the result."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NoReturn

import numpy as np
import trimesh

from tjscan.calibration.file import SavedCalibration, to_calibration_file, write_calibration
from tjscan.calibration.logbook import Logbook
from tjscan.calibration.measuring_range import MeasuringRange
from tjscan.calibration.operator import Operator, Question
from tjscan.calibration.plucker import plane_through_point
from tjscan.calibration.probe import JoggedProbe, TouchProbe
from tjscan.calibration.session import CalibrationPlan
from tjscan.calibration.simulated import SimulatedTouchProbe
from tjscan.calibration.topics import CALIBRATION_RECORDING
from tjscan.calibration.wizard import CalibrationWizard
from tjscan.core.devices import DriverKind
from tjscan.core.errors import CalibrationRefused, ConfigurationError
from tjscan.core.files import lock_and_clean_directory
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.core.units import pose_to_rows_mm
from tjscan.job import (
    CalibrationJob,
    CalibrationSettings,
    SimulatedBoardSettings,
    read_calibration_job,
)
from tjscan.job.cell import Cell, laser_model_of_job, make_cell, sensor_mount_of_job
from tjscan.laser.drivers import SimulatedScene
from tjscan.laser.optics import RaycastSurface
from tjscan.result.directory import CALIBRATION, JOB, job_label_of_run
from tjscan.runs.directory import make_run_directory

OLD: Final = "measured.jsonl"
"""What version 0.1.0 wrote in place of a recording."""

BOARD_THICKNESS: Final = 5e-3
"""Metres, of the simulated board."""

PROBE_STREAM: Final = 2
"""Keeps the random numbers of the probe apart from the arm's and the laser's."""


def start_calibration(
    job: CalibrationJob, job_file: Path, directory: Path, operator: Operator
) -> SavedCalibration:
    """Calibrate as a job says, in a new directory that can be resumed.

    Raises
    ------
    TjscanError
        If the job is wrong, a device fails or the result can't be trusted; what was measured
        until then is kept.
    """
    if any((directory / name).exists() for name in (f"{CALIBRATION_RECORDING}.mcap", OLD)):
        raise ConfigurationError(
            f"holds a calibration already; go on with it: --resume {directory}", file=directory
        )
    # The directory keeps the guess itself: the file it may come from is not its own result.
    guess = CalibrationSettings(T_f_s_mm=pose_to_rows_mm(sensor_mount_of_job(job, job_file).T_f_s))
    alone = job.model_copy(update={"calibration": guess, "joint": None, "scan": None})
    make_run_directory(directory, alone, job_file)
    return resume_calibration(directory, operator)


def resume_calibration(directory: Path, operator: Operator) -> SavedCalibration:
    """Resume an interrupted calibration; raises as `start_calibration` does."""
    job = read_calibration_job(directory / JOB)
    file = directory / CALIBRATION
    if file.exists():
        raise ConfigurationError("is finished already; there is nothing to resume", file=directory)
    if (directory / OLD).exists():
        raise ConfigurationError(
            "was measured by tjscan 0.1.0, and only that version goes on with it: install it to "
            "finish this calibration, or start a new one",
            file=directory / OLD,
        )
    if not operator.present and {job.arm.driver_kind, job.laser.driver_kind} != {
        DriverKind.SIMULATED
    }:
        raise ConfigurationError("a real arm moves only while somebody watches: not unattended")
    T_f_s = sensor_mount_of_job(job, directory / JOB).T_f_s
    cell, probe = make_calibration_cell(job, T_f_s)
    with lock_and_clean_directory(directory), Logbook(directory, T_f_s) as logbook, cell:
        task = calibration_plan_of_job(job, T_f_s)
        outcome = CalibrationWizard(task, cell.arm, cell.laser, probe, operator, logbook).run()
        begun = logbook.measured.started_at
    if not operator.confirm(Question(f"Save it as {file}?", default=True)):
        raise CalibrationRefused("not saved", f"what was measured stays in {directory}")
    found = to_calibration_file(
        outcome.result,
        job.board.noise,
        arm=job.arm.device_id,
        laser=job.laser.device_id,
        date=begun,
        verification=outcome.verification,
    )
    write_calibration(
        file, found, Provenance.for_file_written_now(job_label_of_run(directory), "f")
    )
    return SavedCalibration(file, found, outcome.result.caveats)


def make_calibration_cell(job: CalibrationJob, T_f_s: Array) -> tuple[Cell, TouchProbe]:
    """Make the cell of a calibration, and the probe that touches its board.

    With a real laser a person jogs the arm onto the board; a simulated one looks at a simulated
    board, which the arm touches by itself.

    Parameters
    ----------
    job : CalibrationJob
        The job.
    T_f_s : ndarray, shape (4, 4)
        About where the laser sits.

    Raises
    ------
    ConfigurationError
        As `make_cell` does.
    """
    simulation, board = job.simulation, job.board
    if job.laser.driver_kind is DriverKind.REPLAYED:
        raise ConfigurationError(
            "a calibration touches its board: recorded profiles go in with --lines and --poses",
            key="laser.driver",
        )
    if job.laser.driver_kind is DriverKind.REAL:
        cell = make_cell(job, T_f_s, _refuse_board_without_simulation)
        return cell, JoggedProbe(cell.arm)
    if simulation is None:
        _refuse_board_without_simulation()
    truth = simulation.board or SimulatedBoardSettings(
        position=board.position, euler_zyx=board.euler_zyx
    )
    cell = make_cell(job, T_f_s, lambda: SimulatedScene(_board_surface(board.size), truth.T))
    probe = SimulatedTouchProbe(
        cell.arm,
        np.array(board.probe_tip),
        board.T,
        plane_through_point(truth.T[:3, 3], truth.T[:3, 2]),
        sigma=truth.touch,
        approach=board.approach,
        rng=np.random.default_rng([simulation.seed, PROBE_STREAM]),
    )
    return cell, probe


def _refuse_board_without_simulation() -> NoReturn:
    raise ConfigurationError("a simulated board needs the table [simulation]")


def _board_surface(size: tuple[float, float]) -> RaycastSurface:
    """A plate whose upper face is the plane z = 0 of its frame."""
    plate = trimesh.creation.box((*size, BOARD_THICKNESS))
    return RaycastSurface(plate.vertices - (0.0, 0.0, 0.5 * BOARD_THICKNESS), plate.faces)


def calibration_plan_of_job(job: CalibrationJob, T_f_s: Array) -> CalibrationPlan:
    """Plan of a calibration: what its job says about board, laser and numbers of lines.

    Parameters
    ----------
    job : CalibrationJob
        The job.
    T_f_s : ndarray, shape (4, 4)
        About where the laser sits.
    """
    model, board = laser_model_of_job(job), job.board
    return CalibrationPlan(
        board.T,
        0.5 * np.array(board.size),
        np.array(board.probe_tip),
        T_f_s,
        # That other lasers of this class open their fan as the simulated one is an assumption.
        MeasuringRange(model.near, model.far, model.emitter_z, model.half_angle, model.columns),
        board.noise,
        board.touches,
        board.lines,
    )
