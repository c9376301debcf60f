"""From a job to the model of its laser, and to a laser that no arm carries."""

from __future__ import annotations

from dataclasses import replace
from time import monotonic
from typing import Any

import numpy as np

from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError
from tjscan.job import CellJob
from tjscan.job.devices import DeviceSettings
from tjscan.laser.drivers import LASER_DRIVERS, LaserDriverInputs, LaserFlange
from tjscan.laser.line_laser import LineLaser
from tjscan.laser.model import LaserModel


def laser_model_of_job(job: CellJob) -> LaserModel:
    """The laser that a job describes: the window of [laser], the faults of [simulation.laser]."""
    faults = LaserModel() if job.simulation is None else job.simulation.laser
    table = job.laser
    return replace(faults, columns=table.points, near=table.near, far=table.far)


def make_laser_without_arm(table: DeviceSettings) -> LineLaser:
    """Make a real laser that no arm carries: it is alone, or sits on a vehicle.

    Its profiles are timed by the monotonic clock of this machine.

    Parameters
    ----------
    table : DeviceSettings
        Which laser.

    Raises
    ------
    ConfigurationError
        If it is not a real one, or a package is missing that its driver needs.
    """
    if table.driver_kind is not DriverKind.REAL:
        raise ConfigurationError(f"{table.driver!r} is no real laser", key="laser.driver")
    laser: LineLaser = LASER_DRIVERS.make(
        table.driver,
        LaserDriverInputs(
            LaserModel(),
            LaserFlange(_refuse_without_arm, _refuse_without_arm, monotonic),
            np.eye(4),
            _refuse_without_arm,
            seed=None,
            recording=_refuse_without_arm,
        ),
        table.driver_settings,
    )
    return laser


def _refuse_without_arm() -> Any:
    raise ConfigurationError(
        "this laser's driver asks for an arm's flange, and no arm carries the laser here: it needs "
        "a driver that takes profiles alone",
        key="laser.driver",
    )
