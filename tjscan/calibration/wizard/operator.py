"""The operator of a calibration: a person at a terminal, another front end, or default answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal, Protocol

from tjscan.core.frames import Array
from tjscan.laser.profile import Profile
from tjscan.robot.arm import Arm, ArmState

if TYPE_CHECKING:
    from tjscan.calibration.wizard.logbook import CalibrationEntry
    from tjscan.calibration.wizard.session import CalibrationProgress

Answer = Literal["Take", "Skip", "Redo", "Finish"]
"""Names of yes and no on buttons."""


@dataclass(frozen=True, slots=True)
class Question:
    """A yes-or-no question to the operator.

    Parameters
    ----------
    text : str
        The question.
    default : bool
        Answer without a person.
    moves : bool
        Whether yes makes the arm move.
    yes, no : str
        Their names on buttons.
    T_b_f : ndarray, shape (4, 4), or None
        Pose that yes moves the flange to.
    look : callable or None
        Takes a profile at the present pose, to show while the question waits.
    """

    text: str
    default: bool
    moves: bool = False
    yes: Answer = "Take"
    no: Answer = "Skip"
    T_b_f: Array | None = field(default=None, compare=False)
    look: Callable[[], Profile] | None = field(default=None, compare=False)


class Operator(Protocol):
    """Answers the questions of a calibration and receives its messages."""

    @property
    def present(self) -> bool:
        """Whether a person is there. Without one no real arm moves."""

    def confirm(self, question: Question) -> bool:
        """Answer a question: yes or no."""

    def report(self, message: str) -> None:
        """Receive a message about what happened."""

    def show_uncertainty(self, progress: CalibrationProgress) -> None:
        """Show how far the calibration has come, after each line."""

    def show_entry(self, entry: CalibrationEntry) -> None:
        """Show a measurement, once it is on the disk."""


class DefaultAnswerOperator:
    """Operator without a person: takes every question's default and shows nothing."""

    present = False

    def confirm(self, question: Question) -> bool:
        """Answer with the question's default."""
        return question.default

    def report(self, message: str) -> None:
        """Ignore a message."""

    def show_uncertainty(self, progress: CalibrationProgress) -> None:
        """Show no progress."""

    def show_entry(self, entry: CalibrationEntry) -> None:
        """Show no measurement."""


class TouchProbe(Protocol):
    """Touches the board with the arm's probe tip."""

    @property
    def touch_question(self) -> str:
        """Question to the operator before each touch; yes means that `touch` may go on."""

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


@dataclass(frozen=True, slots=True)
class JoggedProbe:
    """A person jogs the arm until the tip touches; the pose is read from the arm.

    Parameters
    ----------
    arm : Arm
        The arm that carries the tip.
    """

    touch_question: ClassVar[str] = (
        "Jog the probe tip until it just touches the board, then answer yes"
    )

    arm: Arm

    def touch(self, place_b: Array) -> ArmState:
        """Read the arm where the operator has jogged the tip onto the board."""
        return self.arm.state()
