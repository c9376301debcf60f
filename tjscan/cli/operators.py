"""Operators of a calibration: a person at the terminal or the page, or none."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tjscan.calibration.wizard.operator import DefaultAnswerOperator, Operator, Question
from tjscan.cli.interrupt import ctrl_c_presser
from tjscan.cli.options.page import LiveOptions
from tjscan.cli.output.console import print_message
from tjscan.core.errors import ConfigurationError

if TYPE_CHECKING:
    from tjscan.calibration.wizard.session import CalibrationProgress
    from tjscan.job.files import CalibrationJob


class PrintOnlyOperator(DefaultAnswerOperator):
    """Operator without a person: prints what happens, and answers with each question's default."""

    def report(self, message: str) -> None:
        """Print a message about what happened."""
        print_message(message)

    def show_uncertainty(self, progress: CalibrationProgress) -> None:
        """Print the uncertainty of the calibration so far."""
        sure, lines = progress.uncertainty, len(progress.samples)
        how = f"standard uncertainty {1e3 * sure.position:.3f} mm, {np.degrees(sure.rotation):.4f}°"
        if progress.result is None:
            print_message(f"{lines} of {progress.wanted} lines; expected {how}")
            return
        bad = (
            f"; contradicting: {', '.join(progress.result.rejected_sample_names)}"
            if progress.result.rejected_sample_names
            else ""
        )
        print_message(
            f"{lines} of {progress.wanted} lines; {how}, "
            f"condition number {progress.result.condition:.1f}{bad}"
        )


@contextmanager
def chosen_operator(
    job: CalibrationJob, job_file: Path, page: LiveOptions, *, unattended: bool
) -> Iterator[Operator]:
    """Yield the operator of a calibration, on the page, at the terminal or none.

    Raises
    ------
    ConfigurationError
        If there is no terminal to ask at.
    PageUnavailable
        If there is no page to ask on.
    """
    if page.live:
        from tjscan.runs.live.calibration import operator_on_page

        with operator_on_page(
            job, job_file, page.where, print_message, ctrl_c_presser()
        ) as operator:
            yield operator
    else:
        yield PrintOnlyOperator() if unattended else TerminalOperator()


class TerminalOperator(PrintOnlyOperator):
    """Operator who is asked at the terminal.

    Parameters
    ----------
    otherwise : str
        What to do without a terminal.

    Raises
    ------
    ConfigurationError
        If there is no terminal to ask at.
    """

    present = True

    def __init__(self, otherwise: str = "a simulated cell needs none with --unattended") -> None:
        if not sys.stdin.isatty():
            raise ConfigurationError(f"there is no terminal to ask at; {otherwise}")
        self._trusted = False

    def confirm(self, question: Question) -> bool:
        """Ask yes or no at the terminal; for moves there is also a yes to all that follow.

        Raises
        ------
        KeyboardInterrupt
            If the person leaves.
        """
        import questionary

        if not question.moves:
            return bool(questionary.confirm(question.text, default=question.default).unsafe_ask())
        if self._trusted:
            return True
        answers = ["move", "move, and don't ask again", "pass over"]
        answer = questionary.select(question.text, choices=answers).unsafe_ask()
        self._trusted = answer == answers[1]
        return bool(answer != answers[2])
