"""Who answers a calibration's questions by the buttons of the live page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Final

from tjscan.calibration.wizard.operator import Answer, Question
from tjscan.calibration.wizard.session import CalibrationProgress
from tjscan.calibration.wizard.topics import CalibrationEntry
from tjscan.core.devices import DriverKind
from tjscan.core.errors import LaserFault, PageUnavailable
from tjscan.job import CalibrationJob
from tjscan.laser.profile import Profile
from tjscan.live.buttons import Button, Tone
from tjscan.live.listening import RunOnPage, show_run
from tjscan.live.page import PageAddress
from tjscan.live.step import PRESS, STATE, Step
from tjscan.runs.live.calibration import CalibrationNews, CalibrationShow, plane_curve

LOOK_EVERY: Final = 0.2
"""Seconds between two profiles of a real laser while an answer is awaited."""

BUTTONS: Final[tuple[tuple[Answer, Tone, str], ...]] = (
    ("Take", "green", "Do what is asked: the arm may move"),
    ("Skip", "gray", "Pass it over"),
    ("Redo", "yellow", "Measure it again"),
    ("Finish", "blue", "End here, with what there is"),
)


class PageOperator:
    """Operator who is asked on the page.

    Parameters
    ----------
    run : RunOnPage
        The calibration on the page.
    show : CalibrationShow
    report : callable
        Is told every message too.
    looks : bool
        Whether the laser is looked through while an answer is awaited: a simulated one would
        then see other noise in every run.
    """

    present = True

    def __init__(
        self,
        run: RunOnPage[CalibrationNews],
        show: CalibrationShow,
        report: Callable[[str], object],
        *,
        looks: bool,
    ) -> None:
        self._run, self._show, self._report, self._looks = run, show, report, looks
        self._pressed: SimpleQueue[Answer] = SimpleQueue()

    def buttons(self, interrupt: Callable[[], object]) -> list[Button]:
        """Buttons of the page: the answers, and Stop, which does what Ctrl-C does."""

        def pressing(word: Answer) -> Callable[[], object]:
            return lambda: self._pressed.put(word)

        answers = [Button(word, pressing(word), tone, hint) for word, tone, hint in BUTTONS]
        stop = Button("Stop", interrupt, "red", "As Ctrl-C; what was measured stays")
        return [*answers, stop]

    def confirm(self, question: Question) -> bool:
        """Show a question and where it leads; wait for one of its two buttons."""
        self._forget_presses()
        words = f"{question.yes} or {question.no}"
        self._run.post(Step(facts={STATE: question.text, PRESS: words}))
        self._run.post(self._show.next_pose(question.T_b_f))
        self._enable(question.yes, question.no)
        while (answer := self._next_press(question)) not in (question.yes, question.no):
            pass  # of a button that answers nothing now
        self._enable()
        self._run.post(Step(facts={STATE: "working", PRESS: ""}))
        return answer == question.yes

    def report(self, message: str) -> None:
        """Show a message among the events, and pass it on."""
        self._run.post(Step(events=(("", message),)))
        self._report(message)

    def show_uncertainty(self, progress: CalibrationProgress) -> None:
        """Show how sure the pose is, and the lines that it rests on."""
        self._run.post(progress)

    def show_entry(self, entry: CalibrationEntry) -> None:
        """Show what was measured."""
        self._run.post(entry)

    def _enable(self, *words: Answer) -> None:
        if self._run.page is not None:
            self._run.page.enable({word: word in words for word, _, _ in BUTTONS})

    def _forget_presses(self) -> None:
        """A press that came before its question answers none: the arm might move."""
        while not self._pressed.empty():
            self._pressed.get()

    def _next_press(self, question: Question) -> Answer:
        """Next button that is pressed; until then a real laser's profiles are shown."""
        while True:
            look = question.look if self._looks else None
            try:
                return self._pressed.get(timeout=None if look is None else LOOK_EVERY)
            except Empty:
                if look is not None:
                    self._show_profile(look)

    def _show_profile(self, look: Callable[[], Profile]) -> None:
        try:
            profile = look()
        except LaserFault as fault:
            self._run.post(Step(facts={"laser": str(fault)}))
            return
        self._run.post(Step(facts={"laser": ""}, profile=plane_curve(profile)))


@contextmanager
def operator_on_page(
    job: CalibrationJob,
    job_file: Path,
    where: PageAddress,
    report: Callable[[str], object],
    interrupt: Callable[[], object],
) -> Iterator[PageOperator]:
    """Serve a page that asks the calibration's questions while the block runs.

    Parameters
    ----------
    job : CalibrationJob
    job_file : Path
        Where it was read from.
    where : PageAddress
    report : callable
        Is told the page's address, and every message.
    interrupt : callable
        Does what Ctrl-C does.

    Raises
    ------
    PageUnavailable
        If there is no page: nobody would answer.
    """
    show = CalibrationShow(job, job_file, job_file.stem)
    looks = job.laser.driver_kind is DriverKind.REAL
    made: list[PageOperator] = []

    def buttons(run: RunOnPage[CalibrationNews]) -> Sequence[Button]:
        made.append(PageOperator(run, show, report, looks=looks))
        return made[0].buttons(interrupt)

    with show_run(show, where, report, buttons):
        if not made:
            raise PageUnavailable("nobody can answer without the page: leave out --live")
        yield made[0]
