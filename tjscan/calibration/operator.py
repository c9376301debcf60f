"""Who watches a calibration: a person at a terminal, another front end, or nobody."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from tjscan.calibration.session import CalibrationProgress


@dataclass(frozen=True, slots=True)
class Question:
    """A yes-or-no question to the operator.

    Parameters
    ----------
    text : str
        In words.
    default : bool
        What happens when nobody is there to ask.
    moves : bool
        Whether yes makes the arm move.
    """

    text: str
    default: bool
    moves: bool = False


class Operator(Protocol):
    """Whoever answers the questions of a calibration and receives its messages."""

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
