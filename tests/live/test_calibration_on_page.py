"""A calibration answered on the page: one wizard, another operator, the same result."""

import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cells import EXAMPLES
from command import tjscan

from tjscan.calibration.wizard.operator import DefaultAnswerOperator, Question
from tjscan.job.files import CalibrationJob, read_calibration_job
from tjscan.live.access import LOOPBACK_ADDRESS
from tjscan.live.listening import RunOnPage
from tjscan.live.step import Step
from tjscan.runs.calibration.run import start_calibration
from tjscan.runs.live.calibration import CalibrationShow, PageOperator
from tjscan.runs.tasks import read_recorded_show

JOB = EXAMPLES / "calibrate.toml"
SHORT = {"board.touches": 4, "board.lines": 5}


class Person(RunOnPage):
    """Somebody who reads what is asked and presses a button."""

    def __init__(self, show: CalibrationShow, choose: Callable[[str], str]) -> None:
        super().__init__(None, show, print)
        self._choose, self.asked = choose, list[str]()
        self.press: dict[str, Callable[[], object]] = {}

    def record(self, entry: object) -> None:
        if isinstance(entry, Step) and (words := entry.facts.get("press")):
            self.asked.append(entry.facts["state"])
            self.press[self._choose(f"{words}: {entry.facts['state']}")]()


def answer_as_asked(question: str) -> str:
    """Take what is offered; finish where that is offered after enough lines."""
    if "Take one more" in question:
        return "Finish"
    return question.partition(" or ")[0]


@pytest.fixture(scope="module")
def job() -> CalibrationJob:
    return read_calibration_job(JOB, SHORT)


@pytest.fixture(scope="module")
def unattended(job: CalibrationJob, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("calibrations") / "unattended"
    start_calibration(job, JOB, out, DefaultAnswerOperator())
    return out


def test_pressed_through_it_finds_what_it_finds_unattended(
    job: CalibrationJob, unattended: Path, tmp_path: Path
) -> None:
    show = CalibrationShow(job, JOB, "calibration")
    person = Person(show, answer_as_asked)
    operator = PageOperator(person, show, print, looks=False)
    person.press = {button.word: button.press for button in operator.buttons(lambda: None)}
    done = start_calibration(job, JOB, tmp_path / "run", operator)
    rows = [
        line
        for file in (done.file, unattended / "calibration.toml")
        for line in file.read_text(encoding="utf-8").splitlines()
        if line.startswith(("T_f_s_mm", "sigma", "    ["))
    ]
    half = len(rows) // 2
    assert half > 5
    assert rows[:half] == rows[half:]
    assert len(person.asked) >= 4 + 5 + 1  # touches, lines, and whether to save


def test_a_press_from_before_the_question_moves_nothing(job: CalibrationJob) -> None:
    show = CalibrationShow(job, JOB, "calibration")
    person = Person(show, lambda _: "Skip")
    operator = PageOperator(person, show, print, looks=False)
    person.press = {button.word: button.press for button in operator.buttons(lambda: None)}
    person.press["Take"]()
    assert not operator.confirm(Question("Move?", True, moves=True))


def test_its_recording_is_shown_too(unattended: Path) -> None:
    show = read_recorded_show(unattended)
    drawn = {name for step in show.steps for name in step.drawn}
    assert {"arm", "touch/0", "touch/3", "line/line 1", "line/line 5"} <= drawn
    assert np.isfinite(show.setting.look_from).all()


def test_without_a_page_nobody_could_answer(tmp_path: Path) -> None:
    with socket.create_server((LOOPBACK_ADDRESS, 0)) as taken:
        port = taken.getsockname()[1]
        out = ("--out", tmp_path / "run")
        assert tjscan("calibrate", JOB, *out, "--live", "--port", port) == 1
    assert tjscan("calibrate", JOB, *out, "--live", "--unattended") == 2
    assert not (tmp_path / "run").exists()
