"""From a job to the arm, the laser and the calibration: the one place that knows the drivers."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np

from tjscan.errors import ConfigurationError
from tjscan.frames import Array, inverse
from tjscan.job import JobFile, LaserTable, SimulatedLaserTable
from tjscan.joint.definition import JointDefinition
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.model import LaserModel
from tjscan.robot.arm import Arm


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
    """

    arm: Arm
    laser: LineLaser
    T_f_s: Array

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


def open_cell(job: JobFile, joint: JointDefinition | None) -> Cell:
    """Make the cell that a job describes; entering it connects the devices.

    Parameters
    ----------
    job : JobFile
        The job.
    joint : JointDefinition, optional
        What a simulated laser looks at.

    Raises
    ------
    ConfigurationError
        If the arm's model is unknown, or a simulated device lacks what it needs.
    """
