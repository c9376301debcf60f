"""The arms that a job can name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from operator import attrgetter
from time import sleep
from typing import TYPE_CHECKING, Any, Final

from tjscan.core.config import add_file_to_errors
from tjscan.core.devices import DriverFactory, DriverKind, DriverRegistry, NoSettings
from tjscan.core.errors import ConfigurationError
from tjscan.robot.abb.settings import AbbSettings
from tjscan.robot.arm import Arm
from tjscan.robot.cyclic.settings import CyclicSettings
from tjscan.robot.fanuc.settings import FanucSettings
from tjscan.robot.kuka.settings import KukaSettings
from tjscan.robot.ur.settings import UrSettings

if TYPE_CHECKING:
    from tjscan.core.frames import Array
    from tjscan.laser.replay import RecordedPoses
    from tjscan.robot.arm import ArmState
    from tjscan.robot.kinematics import Kinematics
    from tjscan.robot.path import MotionLimits
    from tjscan.robot.settings import ArmSimulationSettings


SWAY_RANDOM_STREAM: Final = 4
"""Keeps the random numbers of gusts apart from those of the arm's make and moves."""


@dataclass(frozen=True, slots=True, eq=False)
class ArmDriverInputs:
    """What an arm's driver makes its arm from, beside its own settings.

    Parameters
    ----------
    kinematics : Kinematics
        Of the model that the job names.
    limits : MotionLimits
        How fast it may move.
    seed : int
        Of a simulation's random numbers.
    simulation : ArmSimulationSettings or None
        The first posture of a simulated arm and how well it repeats; None if the job has no
        [simulation.arm].
    left : ArmState or None
        Where an interrupted scan left the arm: a simulated one is there again.
    recording : callable
        Gives the poses and states of the recording that the job names; raises
        ConfigurationError if it names none.
    """

    kinematics: Kinematics
    limits: MotionLimits
    seed: int
    simulation: ArmSimulationSettings | None
    left: ArmState | None
    recording: Callable[[], tuple[RecordedPoses, tuple[ArmState, ...]]]


@dataclass(frozen=True)
class ArmDriverFactory(DriverFactory[ArmDriverInputs, Arm]):
    """How an arm's driver makes the arm from a job file; see `DriverFactory`.

    Parameters
    ----------
    truth : callable, optional
        Returns the true pose of an arm's flange, shape (4, 4): of a real arm what it reports.
    pass_time : callable, optional
        Lets some seconds pass on an arm's clock: that of a simulated arm runs no other way.
    """

    truth: Callable[[Any], Array] = field(default=lambda arm: arm.state().T_b_f)
    pass_time: Callable[[Any, float], object] = field(default=lambda arm, seconds: sleep(seconds))


def _make_simulated_arm(context: ArmDriverInputs, settings: NoSettings) -> Arm:
    import numpy as np

    from tjscan.robot.simulated import SimulatedArm, SimulatedArmErrors
    from tjscan.robot.sway import SimulatedSway

    world, left = context.simulation, context.left
    if world is None:
        message = "a simulated arm needs a [simulation.arm] table"
        raise ConfigurationError(message, key="simulation.arm")
    with add_file_to_errors(key="simulation.arm.home_deg"):
        arm = SimulatedArm(
            context.kinematics,
            np.array(world.home if left is None else left.q),
            limits=context.limits,
            repeatability=(world.repeatability, world.angular_repeatability),
            seed=context.seed,
            realtime=world.realtime,
            time=0.0 if left is None else left.time,
            errors=None
            if world.errors is None
            else SimulatedArmErrors.draw_true_arm(context.kinematics, world.errors, context.seed),
        )
    arm.lag, arm.wander = world.lag, world.wander
    if world.sway is not None:
        random = np.random.default_rng([context.seed, SWAY_RANDOM_STREAM])
        arm.sway = SimulatedSway(world.sway, random)
    return arm


def _make_replayed_arm(context: ArmDriverInputs, settings: NoSettings) -> Arm:
    from tjscan.robot.replay import ReplayedArm

    return ReplayedArm(*context.recording())


def _make_ur_arm(inputs: ArmDriverInputs, settings: UrSettings) -> Arm:
    from tjscan.robot.ur.arm import UrArm

    if inputs.limits.shaper is not None:
        message = "the controller of this arm times its moves itself: leave [arm.shaper] out"
        raise ConfigurationError(message, key="arm.shaper")
    return UrArm(inputs.kinematics, settings, inputs.limits)


def _make_cyclic_arm(inputs: ArmDriverInputs, settings: CyclicSettings) -> Arm:
    from tjscan.robot.cyclic.arm import CyclicArm

    return CyclicArm(inputs.kinematics, settings, inputs.limits)


ARM_DRIVERS: Final = DriverRegistry(
    "arm",
    {
        "simulated": ArmDriverFactory(
            _make_simulated_arm,
            kind=DriverKind.SIMULATED,
            truth=attrgetter("true_T_b_f"),
            pass_time=lambda arm, seconds: arm.pass_time(seconds),
        ),
        "replay": ArmDriverFactory(_make_replayed_arm, kind=DriverKind.REPLAYED),
        "ur": ArmDriverFactory(_make_ur_arm, UrSettings, extra="ur", client="rtde_control"),
        "abb": ArmDriverFactory(_make_cyclic_arm, AbbSettings),
        "fanuc": ArmDriverFactory(_make_cyclic_arm, FanucSettings),
        "kuka": ArmDriverFactory(_make_cyclic_arm, KukaSettings),
    },
    key="arm.driver",
    type=ArmDriverFactory,
)
"""Every arm driver by name."""
