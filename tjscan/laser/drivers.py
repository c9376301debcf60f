"""The lasers that a job can name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import sleep
from typing import TYPE_CHECKING, Any, Final

from tjscan.core.devices import DriverFactory, DriverKind, DriverRegistry, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.laser.genicam.settings import GenicamSettings, ScanControlSettings
from tjscan.laser.line_laser import LineLaser

if TYPE_CHECKING:
    from tjscan.core.frames import Array
    from tjscan.laser.model import LaserModel
    from tjscan.laser.optics import RaycastSurface
    from tjscan.laser.profile import Profile
    from tjscan.laser.replay import RecordedPoses

LASER_NOISE_RANDOM_STREAM: Final = 1
"""Keeps the random numbers of the laser apart from the arm's, which has the bare seed."""


@dataclass(frozen=True, slots=True, eq=False)
class LaserFlange:
    """Flange that a laser sits on: its true and its reported pose, and the arm's clock.

    Parameters
    ----------
    truth : callable
        Returns the true pose of the flange, shape (4, 4), in frame b; for simulations.
    T_b_f : callable
        Returns the pose that the arm reports, shape (4, 4).
    time : callable
        Returns the seconds on the arm's clock.
    pass_time : callable
        Lets some seconds pass on it.
    """

    truth: Callable[[], Array]
    T_b_f: Callable[[], Array]
    time: Callable[[], float]
    pass_time: Callable[[float], object] = sleep

    @classmethod
    def of_arm(
        cls,
        truth: Callable[[], Array],
        state: Callable[[], Any],
        pass_time: Callable[[float], object] = sleep,
    ) -> LaserFlange:
        """The flange of an arm that reports its state, an `ArmState` of the room above."""
        return cls(truth, lambda: state().T_b_f, lambda: state().time, pass_time)


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedScene:
    """Surface that a simulated laser looks at, and its pose.

    Parameters
    ----------
    surface : RaycastSurface
        Its triangles, in a frame of their own, j.
    T_b_j : ndarray, shape (4, 4)
        True pose of that frame in the base frame.
    """

    surface: RaycastSurface
    T_b_j: Array


@dataclass(frozen=True, slots=True, eq=False)
class LaserDriverInputs:
    """What a laser's driver makes its laser from, beside its own settings.

    Parameters
    ----------
    model : LaserModel
        The window that the job states, and the faults of a simulation.
    carrier : LaserFlange
        The flange it sits on.
    T_f_s : ndarray, shape (4, 4)
        Its true pose on the flange.
    scene : callable
        Gives the `SimulatedScene`; raises ConfigurationError if the job describes none.
    seed : int or None
        Of a simulation's random numbers; None if the job has no [simulation].
    recording : callable
        Gives the poses and profiles of the recording that the job names; raises
        ConfigurationError if it names none.
    """

    model: LaserModel
    carrier: LaserFlange
    T_f_s: Array
    scene: Callable[[], SimulatedScene]
    seed: int | None
    recording: Callable[[], tuple[RecordedPoses, tuple[Profile, ...]]]


LaserDriverFactory = DriverFactory[LaserDriverInputs, LineLaser]


def _make_simulated_laser(context: LaserDriverInputs, settings: NoSettings) -> LineLaser:
    import numpy as np

    from tjscan.core.frames import inverse_pose
    from tjscan.laser.optics import SimulatedLaser

    if context.seed is None:
        raise ConfigurationError("a simulated laser needs a [simulation] table", key="simulation")
    scene = context.scene()
    T_j_b, carrier, T_f_s = inverse_pose(scene.T_b_j), context.carrier, context.T_f_s
    return SimulatedLaser(
        scene.surface,
        # The true pose of the laser, not the one that the arm reports.
        pose=lambda: T_j_b @ carrier.truth() @ T_f_s,
        model=context.model,
        rng=np.random.default_rng([context.seed, LASER_NOISE_RANDOM_STREAM]),
        clock=carrier.time,
        pass_time=carrier.pass_time,
        make=context.seed if context.model.linearity_seed is None else context.model.linearity_seed,
    )


def _make_replayed_laser(context: LaserDriverInputs, settings: NoSettings) -> LineLaser:
    from tjscan.laser.replay import ReplayedLaser

    poses, profiles = context.recording()
    return ReplayedLaser(poses, profiles, context.carrier.T_b_f, context.carrier.time)


def _make_gige_laser(
    inputs: LaserDriverInputs, settings: GenicamSettings | ScanControlSettings
) -> LineLaser:
    from tjscan.laser.genicam.gige import GenicamLaser, ScanControlLaser

    if isinstance(settings, GenicamSettings):
        return GenicamLaser(settings, inputs.carrier.time)
    return ScanControlLaser(settings, inputs.carrier.time)


_gige_driver: Final = partial(
    LaserDriverFactory, _make_gige_laser, extra="genicam", client="viva_genicam"
)

LASER_DRIVERS: Final = DriverRegistry(
    "laser",
    {
        "simulated": LaserDriverFactory(_make_simulated_laser, kind=DriverKind.SIMULATED),
        "replay": LaserDriverFactory(_make_replayed_laser, kind=DriverKind.REPLAYED),
        "genicam": _gige_driver(GenicamSettings),
        "scancontrol": _gige_driver(ScanControlSettings),
    },
    key="laser.driver",
)
"""Every laser driver by name."""
