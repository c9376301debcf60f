"""From a job to the arm, the laser and the calibration: the one place that knows the drivers."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import lru_cache
from math import radians
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np
import trimesh

from tjscan.calibration.file import read_calibration
from tjscan.calibration.plucker import plane_through
from tjscan.calibration.probe import Probe
from tjscan.calibration.session import Task
from tjscan.calibration.simulated import SimulatedProbe
from tjscan.calibration.window import Window
from tjscan.core.config import naming
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, inverse
from tjscan.job import (
    CalibrationJob,
    CellFile,
    JobFile,
    SimulatedBoardTable,
    SimulatedLaserTable,
    StandingTable,
)
from tjscan.job.drivers import PROBE_STREAM, arm_of, laser_model, simulated_laser
from tjscan.joint.definition import JointDefinition
from tjscan.joint.mesh import build_mesh
from tjscan.joint.relief import relief_of
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.optics import Surface
from tjscan.laser.replay import ReplayedLaser
from tjscan.recording.reader import read_recording
from tjscan.robot.arm import Arm, ArmState
from tjscan.robot.clearance import Clearance, Margins
from tjscan.robot.cleared import ClearedArm
from tjscan.robot.collision import CollisionModel, check_links
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.replay import ReplayedArm
from tjscan.robot.solids import Solid
from tjscan.scanning.section import View

BOARD_THICKNESS: Final = 5e-3
"""Metres, of the simulated board."""


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
    clearance : Clearance
        What the arm's paths keep; it wants to be told what is seen.
    """

    arm: Arm
    laser: LineLaser
    T_f_s: Array
    clearance: Clearance

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


@dataclass(frozen=True, slots=True, eq=False)
class Mount:
    """Where the laser sits on the hand, and what says so.

    Parameters
    ----------
    T_f_s : ndarray, shape (4, 4)
        Pose of the laser in the flange frame.
    file : Path or None
        The calibration it comes from; none where the job itself holds it.
    """

    T_f_s: Array
    file: Path | None = None


def mount_of(job: CellFile, job_file: Path) -> Mount:
    """Where the laser sits, as a job says, or a calibration that is sought from the job's folder.

    Raises
    ------
    ConfigurationError
        If the calibration can't be read, or holds for another arm or laser.
    """
    T_f_s = job.calibration.T_f_s
    if T_f_s is not None:
        return Mount(T_f_s)
    file = job_file.parent / str(job.calibration.file)
    # A recording does not say which laser made it, unless the job does.
    laser = job.laser.id if job.laser.is_replay else job.laser.device
    found = read_calibration(file, arm=job.arm.device, laser=laser)
    return Mount(found.T_f_s, file)


def open_cell(
    job: JobFile, T_f_s: Array, joint: JointDefinition | None, left: View | None = None
) -> Cell:
    """Make the cell that a job describes; entering it connects the devices.

    Parameters
    ----------
    job : JobFile
        The job.
    T_f_s : ndarray, shape (4, 4)
        Where the laser sits, see `mount_of`.
    joint : JointDefinition, optional
        What a simulated laser looks at.
    left : View, optional
        Where an interrupted scan left the arm: a simulated one stands there again.

    Raises
    ------
    ConfigurationError
        If the arm's model is unknown, or a simulated device lacks what it needs.
    """
    if job.laser.is_replay:
        return _replaying(job, T_f_s)
    if job.simulation is None or job.joint is None or joint is None:
        raise ConfigurationError("a simulated cell needs the tables [simulation] and [joint]")
    arm, flange = arm_of(job.arm, job.simulation, left)
    surface = _surface(joint)
    T_b_j = inverse(job.T_w_b_true) @ job.joint.T_w_j
    laser = simulated_laser(job.laser, job.simulation, flange, T_f_s, surface, T_b_j)
    return _cleared(job, arm, laser, T_f_s)


def _replaying(job: CellFile, T_f_s: Array) -> Cell:
    """A cell of which nothing is there but its recording."""
    table = job.laser
    with naming(key="laser.recording"):
        views = list(read_recording(Path(table.recording or "")))
    arm = ReplayedArm(
        [ArmState(view.q, view.T_b_f, view.time) for view in views],
        distance=1e-3 * table.replay_tolerance_mm,
        angle=radians(table.replay_tolerance_deg),
    )
    laser = ReplayedLaser([view.profile for view in views], arm.take)
    return Cell(arm, laser, T_f_s, clearance_of(job))


@lru_cache(maxsize=2)
def _surface(joint: JointDefinition) -> Surface:
    """What light hits of a joint; kept, since many cells in a row may look at the same one."""
    mesh = build_mesh(joint)
    return Surface(mesh.vertices, mesh.triangles, relief_of(joint))


def open_board_cell(job: CalibrationJob, T_f_s: Array) -> tuple[Cell, Probe]:
    """Make the cell of a calibration, and the probe that touches its board.

    Parameters
    ----------
    job : CalibrationJob
        The job.
    T_f_s : ndarray, shape (4, 4)
        About where the laser sits.

    Raises
    ------
    ConfigurationError
        As `open_cell` does.
    """
    simulation, board = job.simulation, job.board
    if job.laser.is_replay:
        raise ConfigurationError(
            "a calibration touches its board: recorded profiles go in with --lines and --poses",
            key="laser.driver",
        )
    if simulation is None:
        raise ConfigurationError("a simulated cell needs the table [simulation]")
    arm, flange = arm_of(job.arm, simulation)
    truth = simulation.board or SimulatedBoardTable(
        position_mm=board.position_mm, euler_zyx_deg=board.euler_zyx_deg
    )
    thick = trimesh.creation.box((*1e-3 * np.array(board.size_mm), BOARD_THICKNESS))
    surface = Surface(thick.vertices - (0.0, 0.0, 0.5 * BOARD_THICKNESS), thick.faces)
    laser = simulated_laser(job.laser, simulation, flange, T_f_s, surface, truth.T)
    cell = _cleared(job, arm, laser, T_f_s)
    probe = SimulatedProbe(
        cell.arm,
        1e-3 * np.array(board.probe_tip_mm),
        board.T,
        plane_through(truth.T[:3, 3], truth.T[:3, 2]),
        sigma=1e-3 * truth.touch_mm,
        approach=1e-3 * board.approach_mm,
        rng=np.random.default_rng([simulation.seed, PROBE_STREAM]),
    )
    return cell, probe


def task_of(job: CalibrationJob, T_f_s: Array) -> Task:
    """What a calibration is to do, in metres and radians; T_f_s is where it begins from."""
    model, board = laser_model(job.laser, SimulatedLaserTable()), job.board
    return Task(
        board.T,
        0.5e-3 * np.array(board.size_mm),
        1e-3 * np.array(board.probe_tip_mm),
        T_f_s,
        # That other lasers of this class open their fan as the simulated one is an assumption.
        Window(model.near, model.far, model.emitter_z, model.half_angle, model.columns),
        board.noise.model,
        board.touches,
        board.lines,
    )


def clearance_of(job: CellFile) -> Clearance:
    """What a job's arm keeps clear of, whichever driver moves it.

    Raises
    ------
    ConfigurationError
        If the arm's model is unknown or its geometry can't be read, or an ignored link is unknown.
    """
    table = job.clearance
    with naming(key="arm.model"):
        kinematics = Kinematics.load(job.arm.model)
    with naming(key="clearance.ignore"):
        check_links(kinematics, table.ignore)
    with naming(key="arm.model"):
        model = CollisionModel(
            kinematics,
            [_in_b(one, job) for one in table.solid],
            [one.solid for one in table.tool],
            self_collision=table.self_collision,
            ignored=table.ignore,
        )
    margins = Margins(
        solids=1e-3 * table.margin_mm,
        own=1e-3 * table.self_margin_mm,
        singular=table.smallest_singular_value,
    )
    return Clearance(kinematics, model, margins)


def _in_b(table: StandingTable, job: CellFile) -> Solid:
    """A solid where it stands in frame b; one about the workpiece as far as that is known."""
    solid = table.solid
    return solid if table.frame == "b" else replace(solid, T=inverse(job.T_w_b) @ solid.T)


def _cleared(job: CellFile, arm: Arm, laser: LineLaser, T_f_s: Array) -> Cell:
    """A cell whose arm, whatever it is, looks before it moves."""
    clearance = clearance_of(job)
    lifts = 1e-3 * np.array(job.clearance.lifts_mm)
    return Cell(ClearedArm(arm, clearance, T_f_s, lifts=lifts), laser, T_f_s, clearance)
