"""What a program finds on the controller that runs it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from tjscan.core.frames import Array
from tjscan.robot.kinematics import Kinematics
from tjscan_loopback.ur.motion import Motion

SpeedDrive = Callable[[float, Array, Array], Array]
"""From seconds, joint angles and joint speeds to the joint speeds for these seconds, (6,)."""


class ScriptHost(Protocol):
    """Controller as its programs see it: joints, motions, registers, outputs, settings."""

    kinematics: Kinematics
    q: Array
    speed: Array
    tcp: Array
    payload: float
    centre_of_gravity: list[float]
    gravity: tuple[float, ...]
    input_int: list[int]
    output_int: list[int]
    input_double: list[float]
    output_double: list[float]
    digital_outputs: int
    analog_outputs: list[float]
    patience: float
    refusing: bool
    speed_fraction: float

    @property
    def tick(self) -> float:
        """Seconds from one tick to the next."""
        ...

    @property
    def history(self) -> Sequence[Array]:
        """Joint angles of the last ticks, the latest last."""
        ...

    @property
    def moving(self) -> bool:
        """Whether a motion is under way."""
        ...

    def begin_motion(self, motion: Motion) -> None:
        """Begin a motion; what was left of the tick in which the last one ended counts for it."""
        ...

    def come_to_rest(self, duration: float) -> None:
        """Begin to come to rest within some seconds, all joints in proportion."""
        ...

    def drive(self, speeds: SpeedDrive) -> None:
        """Let the joints turn with a speed that each tick asks for, until another command."""
        ...

    def servo(self, speeds: SpeedDrive, target: Array) -> None:
        """Drive the joints towards a target, which the controller shows as such."""
        ...

    @property
    def target(self) -> Array:
        """Joint angles that were commanded."""
        ...

    def let_go(self) -> None:
        """End the commands to the arm: unless one comes in this tick, it comes to rest."""
        ...

    def stop_instantly(self) -> None:
        """Stop at once."""
        ...

    def pause_program(self) -> None:
        """Pause the program, with the arm at rest, until somebody lets it go on."""
        ...

    def protective_stop(self, reason: str = "") -> None:
        """Stop as the safety system does, for a reason, until it is unlocked."""
        ...
