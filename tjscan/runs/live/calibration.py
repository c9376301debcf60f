"""What the live page shows of a calibration, and how the wizard's questions are answered there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.calibration.targets.target import PosedProfile
from tjscan.calibration.wizard import logbook
from tjscan.calibration.wizard.operator import Answer, Question
from tjscan.calibration.wizard.session import CalibrationProgress
from tjscan.core.devices import DriverKind
from tjscan.core.errors import LaserFault, PageUnavailable
from tjscan.core.frames import Array, pose, rot_z, transform_points
from tjscan.job.cell import kinematics_of_job, sensor_mount_of_job, solids_in_base
from tjscan.job.files import CalibrationJob, read_calibration_job
from tjscan.live.colours import FITTED_COLOUR, LASER_COLOUR, NOMINAL_COLOUR, TOOL_COLOUR
from tjscan.live.drawables import ArmPosture, Drawable, Lines, Surface
from tjscan.live.listening import Report, RunOnPage, show_run
from tjscan.live.page import Act, Button, PageAddress, Tone
from tjscan.live.step import (
    BUTTONS_FACT_NAME,
    STATE_FACT,
    Measure,
    PlaneCurve,
    Sample,
    SceneSetup,
    Step,
)
from tjscan.result.directory import JOB_FILE
from tjscan.robot.settings import Box, Cylinder, Solid
from tjscan.runs.calibration.run import calibration_plan_of_job

POSITION_SIGMA_MEASURE: Final = Measure("position known to", "mm", logarithmic=True)
ROTATION_SIGMA_MEASURE: Final = Measure("rotation known to", "°", logarithmic=True)
RESIDUAL_TABLE_HEAD: Final = ("line", "offset / mm", "residual / σ", "")
"""Of the list of lines."""

AXIS_COLOURS: Final = ((214, 39, 40), (44, 160, 44), (31, 119, 180))
AXIS_LENGTH: Final = 0.1
"""Metres of the drawn axes of the arm's base and the target."""

TOUCH_MARK_HALF_SIZE: Final = 0.015
"""Metres, half the size of the mark on a touched place."""


class CalibrationShow:
    """Turns what a calibration measures into steps of the page.

    Parameters
    ----------
    job : CalibrationJob
    job_file : Path
        The file that it was read from.
    title : str
        Of the run.
    """

    def __init__(self, job: CalibrationJob, job_file: Path, title: str) -> None:
        self._plan = calibration_plan_of_job(job, sensor_mount_of_job(job, job_file).T_f_s)
        self._T_f_s = self._plan.T_f_s
        self.setting = self._make_scene_setup(job, title)

    def step_of_entry(self, entry: object) -> Step:
        """Return what an entry of the logbook, or the progress after a line, changes."""
        match entry:
            case logbook.StartOrResumeEntry():
                return Step("begun", facts={"lines": f"0 of {self._plan.lines}"})
            case logbook.BoardTouch():
                return self._page_step_of_touch(entry)
            case logbook.LaserLineTaken(shot, for_verification):
                return self._profile_step("verification" if for_verification else shot.name, shot)
            case logbook.ArmPoseTaken():
                shot = entry.posed_profile
                return self._profile_step(shot.name, shot, entry.q)
            case logbook.SkippedPose():
                return Step("skipped", events=(("passed over", entry.reason),))
            case CalibrationProgress():
                return self._page_step_of_progress(entry)
        return Step()

    def draw_next_pose(self, T_b_f: Array | None) -> Step:
        """Draw the target of the next move: the flange's axes, and the laser's plane from there."""
        if T_b_f is None:
            return Step(drawn={"next": Lines(np.empty((0, 2, 3)), FITTED_COLOUR)})
        T_b_s, window = T_b_f @ self._T_f_s, self._plan.window
        reach = window.far * np.tan(window.half_angle)
        corners = transform_points(T_b_s, [(-reach, 0, window.far), (reach, 0, window.far)])
        fan = np.vstack((T_b_s[:3, 3], corners, T_b_s[:3, 3]))
        axes = [np.stack((T_b_f[:3, 3], T_b_f[:3, 3] + 0.1 * axis)) for axis in T_b_f[:3, :3].T]
        way = np.stack((T_b_f[:3, 3], T_b_s[:3, 3]))
        tip = transform_points(T_b_f, self._plan.tip_f)
        lines = (fan, way, *axes, np.stack((T_b_f[:3, 3], tip)), *_cross_at(tip))
        return Step(drawn={"next": Lines.through(*lines, colour=FITTED_COLOUR, width=3.0)})

    def _make_scene_setup(self, job: CalibrationJob, title: str) -> SceneSetup:
        board, (x, y) = self._plan.T_b_board, self._plan.half_sizes
        corners = [(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)]
        triangles = np.array([(0, 1, 2), (0, 2, 3)])
        face = Surface(transform_points(board, corners), triangles, NOMINAL_COLOUR, 0.6)
        at = 0.6 * board[:3, 3] + (0.0, 0.0, 0.2)
        away = float(np.linalg.norm(at[:2]))
        out = 3.2 * max(away, 0.4)
        aside = rot_z(np.radians(-65)) @ np.array((*(at[:2] / max(away, 1e-6)), 0.0))
        return SceneSetup(
            title,
            (POSITION_SIGMA_MEASURE, ROTATION_SIGMA_MEASURE),
            "lines taken",
            False,
            kinematics_of_job(job),
            solids_in_base(job),
            tuple(one.solid for one in job.clearance.tool) or tuple(self._sensor_and_probe()),
            ghost=(face, *_axes_lines(np.eye(4)), *_axes_lines(board)),
            look_at=at,
            look_from=at + out * aside + (0.0, 0.0, 0.6 * out),
        )

    def _sensor_and_probe(self) -> Iterator[Solid]:
        """Sensor and probe of an arm whose job states no tool: a box, and a rod to its tip."""
        yield Solid("sensor", Box((0.06, 0.09, 0.05)), self._T_f_s)
        tip = np.asarray(self._plan.tip_f)
        if (length := float(np.linalg.norm(tip))) > 0:
            turn = Rotation.align_vectors([tip / length], [(0.0, 0.0, 1.0)])[0].as_matrix()
            yield Solid("probe", Cylinder(0.004, length), pose(turn, 0.5 * tip))

    def _page_step_of_touch(self, touch: logbook.BoardTouch) -> Step:
        label = f"place {touch.place_number + 1}"
        if touch.T_b_f is None:
            return Step(label, events=(("passed over", label),))
        tip = transform_points(touch.T_b_f, self._plan.tip_f)
        cross = Lines.through(*_cross_at(tip), colour=TOOL_COLOUR, width=3.0)
        drawn: dict[str, Drawable] = {f"touch/{touch.place_number}": cross}
        if touch.q is not None:
            drawn["arm"] = ArmPosture(touch.q)
        return Step(label, drawn, {"touched": f"{label} of {self._plan.touches}"})

    def _profile_step(self, label: str, shot: PosedProfile, q: Array | None = None) -> Step:
        points = shot.profile.points_s
        points = points[np.isfinite(points).all(axis=1)]
        posture = shot.q if q is None else q
        drawn: dict[str, Drawable] = {} if posture is None else {"arm": ArmPosture(posture)}
        if len(points) > 1:
            seen = transform_points(shot.T_b_f @ self._T_f_s, points[:: max(1, len(points) // 48)])
            drawn[f"line/{label}"] = Lines.through(seen, colour=LASER_COLOUR, width=2.5)
        return Step(label, drawn, {"taken": label}, profile=PlaneCurve.of_profile(shot.profile))

    def _page_step_of_progress(self, progress: CalibrationProgress) -> Step:
        """How sure the pose is after each line; the lines in the table, and where they belong."""
        sure, taken = progress.uncertainty, len(progress.samples)
        values = {
            POSITION_SIGMA_MEASURE.name: 1e3 * sure.position,
            ROTATION_SIGMA_MEASURE.name: float(np.degrees(sure.rotation)),
        }
        expected = "" if progress.result else " expected"
        facts = {
            "lines": f"{taken} of {progress.wanted}",
            "certain to": "{:.3g} mm, {:.3g}°".format(*values.values()) + expected,
        }
        rows = [(sample.name, "", "", "") for sample in progress.samples]
        if (result := progress.result) is not None:
            self._T_f_s = result.T_f_s
            rows = []
            for one in result.residuals:
                note = "" if one.used else "left out"
                rows.append((one.name, f"{1e3 * one.offset:+.3f}", f"{one.misfit:.1f}", note))
        share, samples = min(taken / progress.wanted, 1.0), (Sample(float(taken), values),)
        return Step(f"{taken} lines", {}, facts, share, samples, table=[RESIDUAL_TABLE_HEAD, *rows])


def _cross_at(tip: Array) -> list[Array]:
    return [np.stack((tip - arm, tip + arm)) for arm in TOUCH_MARK_HALF_SIZE * np.eye(3)]


def _axes_lines(T: Array) -> Iterator[Lines]:
    """Axes of a frame: x red, y green, z blue."""
    for axis, colour in zip(T[:3, :3].T, AXIS_COLOURS, strict=True):
        end = T[:3, 3] + AXIS_LENGTH * axis
        yield Lines.through(np.stack((T[:3, 3], end)), colour=colour, width=3.0)


def read_calibration_show(directory: Path) -> tuple[CalibrationShow, Iterable[object]]:
    """Read what a calibration's recording has to show; see `tjscan.live.step.ReplayReader`."""
    job_file = directory / JOB_FILE
    show = CalibrationShow(read_calibration_job(job_file), job_file, directory.resolve().name)
    return show, logbook.read_calibration_entries(directory)


PROFILE_PREVIEW_INTERVAL: Final = 0.2
"""Seconds between two profiles of a real laser while an answer is awaited."""

ANSWER_BUTTONS: Final[tuple[tuple[Answer, Tone, str], ...]] = (
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
        Receives every message too.
    looks : bool
        Whether the laser is looked through while an answer is awaited: a simulated one would
        then see other noise in every run.
    """

    present = True

    def __init__(
        self, run: RunOnPage, show: CalibrationShow, report: Report, *, looks: bool
    ) -> None:
        self._run, self._show, self._report, self._looks = run, show, report, looks
        self._pressed: SimpleQueue[Answer] = SimpleQueue()

    def buttons(self, interrupt: Act) -> list[Button]:
        """Buttons of the page: the answers, and Stop, which does what Ctrl-C does."""
        answers = [
            Button(word, partial(self._pressed.put, word), tone, hint)
            for word, tone, hint in ANSWER_BUTTONS
        ]
        stop = Button("Stop", interrupt, "red", "As Ctrl-C; what was measured stays")
        return [*answers, stop]

    def confirm(self, question: Question) -> bool:
        """Show a question and the target of its move; wait for one of its two buttons."""
        while not self._pressed.empty():  # an earlier press answers none: the arm might move
            self._pressed.get()
        words = f"{question.yes} or {question.no}"
        self._run.record(Step(facts={STATE_FACT: question.text, BUTTONS_FACT_NAME: words}))
        self._run.record(self._show.draw_next_pose(question.T_b_f))
        self._enable_buttons(question.yes, question.no)
        while (answer := self._wait_for_button(question)) not in (question.yes, question.no):
            pass  # of a button that answers nothing now
        self._enable_buttons()
        self._run.record(Step(facts={STATE_FACT: "working", BUTTONS_FACT_NAME: ""}))
        return answer == question.yes

    def report(self, message: str) -> None:
        """Show a message among the events, and pass it on."""
        self._run.record(Step(events=(("", message),)))
        self._report(message)

    def show_uncertainty(self, progress: CalibrationProgress) -> None:
        """Show how sure the pose is, and the lines that it rests on."""
        self._run.record(progress)

    def show_entry(self, entry: logbook.CalibrationEntry) -> None:
        """Show what was measured."""
        self._run.record(entry)

    def _enable_buttons(self, *words: Answer) -> None:
        if self._run.page is not None:
            self._run.page.enable_buttons({word: word in words for word, _, _ in ANSWER_BUTTONS})

    def _wait_for_button(self, question: Question) -> Answer:
        """Next button that is pressed; until then a real laser's profiles are shown."""
        look = question.look if self._looks else None
        if look is None:
            return self._pressed.get()
        while True:
            with suppress(Empty):
                return self._pressed.get(timeout=PROFILE_PREVIEW_INTERVAL)
            try:
                profile = PlaneCurve.of_profile(look())
                self._run.record(Step(facts={"laser": ""}, profile=profile))
            except LaserFault as fault:
                self._run.record(Step(facts={"laser": str(fault)}))


@contextmanager
def operator_on_page(
    job: CalibrationJob, job_file: Path, where: PageAddress, report: Report, interrupt: Act
) -> Iterator[PageOperator]:
    """Serve a page that asks the calibration's questions while the block runs.

    Parameters
    ----------
    job : CalibrationJob
    job_file : Path
        The file that it was read from.
    where : PageAddress
    report : callable
        Receives the page's address, and every message.
    interrupt : callable
        Does what Ctrl-C does.

    Raises
    ------
    PageUnavailable
        If there is no page: questions would have no answer.
    """
    show = CalibrationShow(job, job_file, job_file.stem)
    looks = job.laser.driver_kind is DriverKind.REAL

    def before() -> Iterator[Step]:
        if job.simulation is not None and job.simulation.arm is not None:
            yield Step(drawn={"arm": ArmPosture(np.array(job.simulation.arm.home))})

    with show_run(show, where, report, lambda _: (), before) as run:
        if run.page is None:
            raise PageUnavailable("questions can't be answered without the page: leave out --live")
        operator = PageOperator(run, show, report, looks=looks)
        run.page.add_buttons(operator.buttons(interrupt))
        yield operator
