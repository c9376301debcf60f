"""Touching the board with the arm's probe tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

from tjscan.core.frames import Array
from tjscan.robot.arm import Arm, ArmState


class TouchProbe(Protocol):
    """Touches the board with the arm's probe tip."""

    @property
    def touch_question(self) -> str:
        """Question to the operator before each touch; yes means that `touch` may go on."""
        ...

    def touch(self, place_b: Array) -> ArmState:
        """Touch the board near a point, shape (3,), and leave.

        Returns
        -------
        ArmState
            While the tip touched, as the arm read it.

        Raises
        ------
        PoseUnreachable
            If the arm can't reach there.
        """
        ...


@dataclass(frozen=True, slots=True)
class JoggedProbe:
    """A person jogs the arm until the tip touches; the pose is read from the arm.

    Parameters
    ----------
    arm : Arm
        The arm that carries the tip.
    """

    touch_question: ClassVar[str] = (
        "Jog the probe tip until it just touches the board, then say yes"
    )

    arm: Arm

    def touch(self, place_b: Array) -> ArmState:
        """Read the arm where the operator has jogged the tip onto the board."""
        return self.arm.state()
