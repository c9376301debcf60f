"""Who watches a calibration: a person at a terminal, another front end, or nobody."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from tjscan.calibration.session import CalibrationProgress


@dataclass(frozen=True, slots=True)
class Question:
    """Something to say yes or no to.

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
    """Answers questions and receives messages."""

    @property
    def present(self) -> bool:
        """Whether a person is there. Without one no real arm moves."""
        ...

    def confirm(self, question: Question) -> bool:
        """Say yes or no."""
        ...

    def report(self, message: str) -> None:
        """Receive a message about what happened."""
        ...

    def show_progress(self, progress: CalibrationProgress) -> None:
        """Show how far the calibration has come, after each line."""
        ...


class SilentOperator:
    """Takes every question's default and receives no messages."""

    present = False

    def confirm(self, question: Question) -> bool:
        """Say what the question proposes."""
        return question.default

    def report(self, message: str) -> None:
        """Let it pass."""

    def show_progress(self, progress: CalibrationProgress) -> None:
        """Show nothing."""
