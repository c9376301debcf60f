"""The operator of a calibration: a person at a terminal, another front end, or default answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol

from tjscan.core.frames import Array
from tjscan.laser.profile import Profile

if TYPE_CHECKING:
    from tjscan.calibration.wizard.session import CalibrationProgress
    from tjscan.calibration.wizard.topics import CalibrationEntry

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
        ...

    def confirm(self, question: Question) -> bool:
        """Answer a question: yes or no."""
        ...

    def report(self, message: str) -> None:
        """Receive a message about what happened."""
        ...

    def show_uncertainty(self, progress: CalibrationProgress) -> None:
        """Show how far the calibration has come, after each line."""
        ...

    def show_entry(self, entry: CalibrationEntry) -> None:
        """Show a measurement, once it is on the disk."""
        ...


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
