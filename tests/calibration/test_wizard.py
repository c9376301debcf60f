"""The wizard: nothing moves unasked, nothing measured is lost, and the truth is found."""

import json
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from calibration_stage import MM, raised
from cells import EXAMPLES, PAPER
from command import tjscan
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from hypothesis import given, settings
from hypothesis import strategies as st
from prompt_toolkit.application import create_app_session
from prompt_toolkit.input import create_pipe_input
from prompt_toolkit.output import DummyOutput
from raw_topics import raw_topic
from scipy.spatial.transform import Rotation
from written import content

from tjscan.calibration.checks import FreshLineVerification
from tjscan.calibration.file import read_calibration
from tjscan.calibration.result import HandEyeCalibration
from tjscan.calibration.targets.target import PosedProfile
from tjscan.calibration.wizard.logbook import (
    CALIBRATION_RECORDING_KIND,
    BoardTouch,
    CalibrationEntry,
    LaserLineTaken,
    Logbook,
    MeasurementsSoFar,
    SkippedPose,
    StartOrResumeEntry,
    messages_of_entry,
    read_calibration_entries,
)
from tjscan.calibration.wizard.operator import JoggedProbe, Question
from tjscan.calibration.wizard.session import CalibrationPlan, CalibrationProgress
from tjscan.calibration.wizard.simulated import SimulatedTouchProbe
from tjscan.calibration.wizard.wizard import (
    MAX_RETOUCHES,
    MAX_SKIPPED_IN_A_ROW,
    CalibrationWizard,
)
from tjscan.cli.output.calibration import TerminalOperator
from tjscan.core.errors import CalibrationRefused, RecordingError
from tjscan.core.frames import Array, inverse_pose, pose
from tjscan.core.units import pose_from_rows_mm, pose_to_rows_mm
from tjscan.job.cell import Cell, sensor_mount_of_job
from tjscan.job.files import read_calibration_job
from tjscan.laser.profile import Profile
from tjscan.recording.foxglove import PROFILE_TOPIC, TRANSFORMS_TOPIC
from tjscan.recording.journal import RecordingWriter
from tjscan.recording.reader import read_messages
from tjscan.robot.arm import ArmState
from tjscan.runs.calibration.run import (
    calibration_plan_of_job,
    make_calibration_cell,
    resume_calibration,
    start_calibration,
)

JOB = EXAMPLES / "calibrate.toml"
SHORT = {"board.touches": 4, "board.lines": 5}
"""As few touches and lines as give a calibration that can be checked."""
TRUTH = pose_from_rows_mm(read_calibration_job(JOB).simulation.T_f_s_mm)  # type: ignore[union-attr, arg-type]


class Watcher:
    """An operator who answers by a rule and remembers what was asked and told."""

    present = True

    def __init__(self, answer: Callable[[Question], bool] = lambda q: q.default) -> None:
        self._answer = answer
        self.questions: list[Question] = []
        self.told: list[str] = []
        self.progress: list[CalibrationProgress] = []

    def confirm(self, question: Question) -> bool:
        self.questions.append(question)
        return self._answer(question)

    def report(self, message: str) -> None:
        self.told.append(message)

    def show_uncertainty(self, progress: CalibrationProgress) -> None:
        self.progress.append(progress)

    def show_entry(self, entry: CalibrationEntry) -> None:
        pass


class Stage:
    """Task and devices of the example, ready for a wizard."""

    def __init__(self, folder: Path, **keys: Any) -> None:
        job = read_calibration_job(JOB, SHORT | {k.replace("__", "."): v for k, v in keys.items()})
        T_f_s = sensor_mount_of_job(job, JOB).T_f_s
        self.task: CalibrationPlan = calibration_plan_of_job(job, T_f_s)
        self.cell: Cell
        self.cell, self.probe = make_calibration_cell(job, T_f_s)
        self.folder = folder

    def run(
        self, watcher: Watcher, **devices: Any
    ) -> tuple[HandEyeCalibration, FreshLineVerification]:
        with Logbook(self.folder, self.task.T_f_s) as logbook, self.cell as cell:
            parts: dict[str, Any] = {"laser": cell.laser, "probe": self.probe} | devices
            return CalibrationWizard(
                self.task, cell.arm, operator=watcher, logbook=logbook, **parts
            ).run()

    def measured(self) -> MeasurementsSoFar:
        with Logbook(self.folder, self.task.T_f_s) as logbook:
            return logbook.measured


class Knocked:
    """The cell's laser, whose bracket moves by 2 mm after some profiles."""

    def __init__(self, cell: Cell, after: int, until: int = 1000) -> None:
        self._cell, self._after, self._until, self._count = cell, after, until, 0

    def capture(self) -> Profile:
        self._count += 1
        profile = self._cell.laser.capture()
        bent = self._after < self._count <= self._until
        return raised(profile, 2 * MM) if bent else profile


class Clumsy:
    """The cell's probe, that slips by 3 mm at some touches."""

    touch_question = "Touch"

    def __init__(self, probe: SimulatedTouchProbe, slips: int) -> None:
        self._probe, self._slips = probe, slips

    def touch(self, place_b: Array) -> ArmState:
        state = self._probe.touch(place_b)
        self._slips -= 1
        return (
            replace(state, T_b_f=pose(p=(0, 0, 3 * MM)) @ state.T_b_f)
            if self._slips >= 0
            else state
        )


def off(T_f_s: Array) -> tuple[float, float]:
    """Metres and radians from the truth."""
    turn = Rotation.from_matrix(TRUTH[:3, :3].T @ T_f_s[:3, :3]).magnitude()
    return float(np.linalg.norm(T_f_s[:3, 3] - TRUTH[:3, 3])), float(turn)


def entries(directory: Path) -> list[tuple[str, bytes]]:
    """Kind of each entry, and what is written of it."""
    return [
        (kind(entry), b"".join(topic.encode(one) for topic, one in messages_of_entry(0, entry)))
        for entry in read_calibration_entries(directory)
        if not isinstance(entry, StartOrResumeEntry)
    ]


def kind(entry: CalibrationEntry) -> str:
    if isinstance(entry, LaserLineTaken):
        return "fresh" if entry.for_verification else "line"
    return type(entry).__name__.lower()


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of the whole example, run without questions from the command line."""
    directory = tmp_path_factory.mktemp("calibrated") / "run"
    assert tjscan("calibrate", JOB, "--unattended", "--out", directory) == 0
    return directory


def test_the_hidden_truth_is_found_as_surely_as_is_claimed(calibrated: Path) -> None:
    found = read_calibration(calibrated / "calibration.toml", arm="ur10e", laser="simulated")
    guess = off(sensor_mount_of_job(read_calibration_job(JOB), JOB).T_f_s)
    position, rotation = off(found.T_f_s)
    assert position < 3e-3 * found.sigma_position_mm < guess[0]
    assert rotation < 3 * np.radians(found.sigma_rotation_deg)
    assert found.sigma_position_mm < 0.12
    assert found.lines == 12
    assert found.verification is not None
    assert found.verification.misfit < found.verification.limit
    files = {"SHA256SUMS", "job.toml", f"{CALIBRATION_RECORDING_KIND}.mcap", "calibration.toml"}
    files |= {"report.html", "calibration.png"}
    assert found.basis is not None
    assert [step.lines for step in found.basis.shrinking][-1] == 12
    assert {file.name for file in calibrated.iterdir()} == files


def corner_error(folder: Path, *options: object) -> float:
    assert tjscan("scan", PAPER, "--out", folder, *options) == 0
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return float(summary["corner_error_mm"]["mean"])


def test_a_scan_with_the_result_is_as_good_as_one_with_the_truth(
    calibrated: Path, tmp_path: Path
) -> None:
    best = corner_error(tmp_path / "true")
    found = corner_error(tmp_path / "found", "--calibration.file", calibrated / "calibration.toml")
    guess = corner_error(
        tmp_path / "guess",
        "--calibration.T_f_s_mm",
        json.dumps(read_calibration_job(JOB).calibration.T_f_s_mm),
        "--scan.sections",
        "5",
    )
    assert found <= best + 0.1
    assert guess > best + 1  # so the calibration was worth it


def test_a_scan_keeps_the_calibration_it_was_made_with(calibrated: Path, tmp_path: Path) -> None:
    file = calibrated / "calibration.toml"
    options = ["--scan.sections", "3"]
    out = tmp_path / "run"
    assert tjscan("scan", PAPER, "--calibration.file", file, *options, "--out", out) == 0
    assert (out / "calibration.toml").read_bytes() == file.read_bytes()
    assert 'file = "calibration.toml"' in (out / "job.toml").read_text(encoding="utf-8")
    found = read_calibration(file)
    named = json.loads((out / "summary.json").read_text(encoding="utf-8"))["calibration"]
    assert named == f"{found.arm} with {found.laser}, {found.date:%Y-%m-%d %H:%M}"
    told = (out / "report.html").read_text(encoding="utf-8")
    assert f"known to {found.sigma_position_mm:.3f} mm" in " ".join(told.split())
    assert "was not calibrated" not in told
    again = tmp_path / "again"
    assert tjscan("scan", out / "job.toml", "--out", again) == 0
    assert content(again / "sections.csv") == content(out / "sections.csv")


@pytest.mark.parametrize(
    ("key", "device"), [("arm.id", "arm 3"), ("laser.id", "2610-100 7"), ("arm.model", "ur20")]
)
def test_a_scan_refuses_the_calibration_of_another_device(
    calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], key: str, device: str
) -> None:
    options = ["--calibration.file", calibrated / "calibration.toml", f"--{key}", device]
    assert tjscan("scan", PAPER, *options, "--out", tmp_path / "run") == 2
    told = " ".join(capsys.readouterr().err.split())
    assert device in told
    assert "calibrate again" in told
    assert not (tmp_path / "run").exists()


def test_interrupted_before_every_question_it_loses_nothing_and_measures_nothing_twice(
    tmp_path: Path,
) -> None:
    directory, kept, asked = tmp_path / "run", list[tuple[str, bytes]](), set[str]()
    job = read_calibration_job(JOB, SHORT)

    def leave_at_the_first_new_question(question: Question) -> bool:
        if question.text in asked:
            return question.default
        asked.add(question.text)
        raise KeyboardInterrupt

    watcher = Watcher(leave_at_the_first_new_question)
    with pytest.raises(KeyboardInterrupt):
        start_calibration(job, JOB, directory, watcher)
    while not (directory / "calibration.toml").exists():
        before = len(asked)
        with suppress(KeyboardInterrupt):
            resume_calibration(directory, watcher)
        now = entries(directory)
        assert now[: len(kept)] == kept
        assert len(now) <= len(kept) + 1
        assert len(asked) > before or (directory / "calibration.toml").exists()
        kept = now
    assert [name for name, _ in kept] == ["boardtouch"] * 4 + ["line"] * 5 + ["fresh"]
    found = read_calibration(directory / "calibration.toml")
    assert off(found.T_f_s)[0] < 4e-3 * found.sigma_position_mm


def test_the_same_lines_give_the_same_calibration_and_no_move(
    calibrated: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("job.toml", f"{CALIBRATION_RECORDING_KIND}.mcap"):
        (copy / name).write_bytes((calibrated / name).read_bytes())
    watcher = Watcher()
    resume_calibration(copy, watcher)
    assert not any(question.moves for question in watcher.questions)
    found, first = (content(d / "calibration.toml") for d in (copy, calibrated))
    assert found == first


def test_a_guess_that_is_far_off_leads_to_the_same_place(tmp_path: Path) -> None:
    turn = Rotation.from_rotvec(np.radians(10) * np.array((0.6, 0.8, 0.0))).as_matrix()
    guess = pose(turn @ TRUTH[:3, :3], TRUTH[:3, 3] + 20 * MM * np.array((0.0, 0.6, -0.8)))
    rows = [list(row) for row in pose_to_rows_mm(guess)]
    result, _ = Stage(tmp_path, calibration__T_f_s_mm=rows, board__lines=8).run(Watcher())
    assert off(result.T_f_s)[0] < 3 * result.uncertainty.position < 0.5 * MM


def test_uncertainty_shrinks_from_line_to_line(tmp_path: Path) -> None:
    watcher = Watcher()
    Stage(tmp_path, board__lines=8).run(watcher)
    assert [len(p.samples) for p in watcher.progress] == list(range(9))
    course = [p.expected.position for p in watcher.progress]
    # The geometry's foresight changes a little where the mount becomes known.
    assert all(after < 1.02 * before for before, after in pairwise(course))
    assert watcher.progress[4].result is None
    assert watcher.progress[5].result is not None


def test_nothing_moves_unless_it_is_allowed(tmp_path: Path) -> None:
    stage, watcher = Stage(tmp_path), Watcher(lambda question: not question.moves)
    with pytest.raises(CalibrationRefused, match="too few touched points"):
        stage.run(watcher)
    with stage.cell as cell:
        assert cell.arm.state().time == 0
    assert sum(question.moves for question in watcher.questions) == 4


def test_what_is_declined_is_passed_over_and_not_asked_again(tmp_path: Path) -> None:
    declined = {"place 2", "Take line 3"}

    def answer(question: Question) -> bool:
        hit = next((words for words in declined if words in question.text), None)
        declined.discard(hit or "")
        return question.default and hit is None

    stage = Stage(tmp_path)
    stage.run(Watcher(answer))
    measured = stage.measured()
    assert measured.touches[1].T_b_f is None
    assert len(measured.line_profiles) == 5
    (passed,) = measured.skipped_poses
    assert passed.reason == "declined"
    for shot in measured.line_profiles:
        assert not np.allclose(shot.T_b_f, passed.T_b_f, atol=1e-3)


def test_one_more_line_is_taken_where_the_operator_wants_it(tmp_path: Path) -> None:
    wishes = iter([True, True, False])

    def answer(question: Question) -> bool:
        return next(wishes) if "one more line" in question.text else question.default

    stage = Stage(tmp_path)
    assert len(stage.run(Watcher(answer))[0].residuals) == 7


def test_a_touch_that_slipped_is_found_and_taken_again(tmp_path: Path) -> None:
    stage, watcher = Stage(tmp_path, board__touches=9), Watcher()
    assert isinstance(stage.probe, SimulatedTouchProbe)
    stage.run(watcher, probe=Clumsy(stage.probe, slips=1))
    assert any("not on one plane" in told for told in watcher.told)
    assert [q.text for q in watcher.questions if "again" in q.text] == ["Touch place 1 again?"]


def test_a_board_that_is_not_flat_is_refused_in_the_end(tmp_path: Path) -> None:
    watcher = Watcher()
    with pytest.raises(CalibrationRefused, match="not on one plane"):
        Stage(tmp_path, board__touches=9, simulation__board__touch_mm=1.5).run(watcher)
    assert sum("again" in question.text for question in watcher.questions) == MAX_RETOUCHES


def test_a_line_taken_while_something_moved_is_named(tmp_path: Path) -> None:
    stage = Stage(tmp_path, board__lines=10)
    result = stage.run(Watcher(), laser=Knocked(stage.cell, after=6, until=7))[0]
    assert result.rejected_sample_names == ("line 7",)


def test_a_fresh_line_that_contradicts_is_refused_unless_the_operator_insists(
    tmp_path: Path,
) -> None:
    stage = Stage(tmp_path, board__lines=10)
    with pytest.raises(CalibrationRefused, match="fresh line contradicts"):
        stage.run(Watcher(), laser=Knocked(stage.cell, after=10))
    # What was measured is still there, and the same question is asked again.
    insist = Watcher(lambda q: True if "contradicts" in q.text else q.default)
    assert not stage.run(insist)[1].line_agrees
    assert not any(question.moves for question in insist.questions)


def test_a_board_that_is_never_seen_ends_it(tmp_path: Path) -> None:
    stage = Stage(tmp_path, laser__near_mm=600.0, laser__far_mm=610.0)
    # The job promises a range that this sensor does not have.
    stage.task = replace(stage.task, window=replace(stage.task.window, near=0.19, far=0.29))
    watcher = Watcher()
    with pytest.raises(CalibrationRefused, match=r"no line to be had.*0 points"):
        stage.run(watcher)
    assert sum("no line there" in told for told in watcher.told) == MAX_SKIPPED_IN_A_ROW


def test_a_board_out_of_reach_is_told(tmp_path: Path) -> None:
    watcher = Watcher()
    with pytest.raises(CalibrationRefused, match="too few touched points"):
        Stage(tmp_path, board__position_mm=[2500.0, 0.0, 0.0]).run(watcher)
    assert any("passed over" in told and "reach" in told for told in watcher.told)


def test_a_real_arm_is_jogged_onto_the_board_by_hand(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    hand, places = stage.probe, iter(stage.task.touch_points)
    read: list[Array] = []

    class JoggingHand:
        """Reads the pose that the hand left the arm in."""

        touch_question = JoggedProbe(stage.cell.arm).touch_question

        def touch(self, place_b: Array) -> ArmState:
            state = JoggedProbe(stage.cell.arm).touch(place_b)
            read.append(state.T_b_f)
            return state

    def answer(question: Question) -> bool:
        if question.text.startswith("Jog"):
            stage.cell.arm.move_joint_to_pose(hand.touch(next(places)).T_b_f)
        return question.default

    result, _ = stage.run(Watcher(answer), probe=JoggingHand())
    assert off(result.T_f_s)[0] < 4 * result.uncertainty.position
    tips = [(T @ np.append(stage.task.tip_f, 1.0))[:3] for T in read]
    np.testing.assert_allclose(tips, stage.task.touch_points, atol=10 * MM)


def test_the_tip_touches_where_the_arm_truly_is(tmp_path: Path) -> None:
    """An arm that is off reads the touch off by as much."""
    keys = {"board__touch_mm": 0.0, "arm__errors": {"seed": 4}, "arm__repeatability_mm": 0.0}
    stage = Stage(tmp_path, **{f"simulation__{key}": value for key, value in keys.items()})
    with stage.cell as cell:
        read = stage.probe.touch(stage.task.touch_points[0])
        there = cell.arm.move_linear(read.T_b_f)
        tip_b = cell.true_flange() @ np.append(stage.task.tip_f, 1.0)
    assert isinstance(stage.probe, SimulatedTouchProbe)
    assert abs(stage.probe.plane.signed_distances(tip_b[:3])) < 1e-6
    told_b = there.T_b_f @ np.append(stage.task.tip_f, 1.0)
    assert abs(stage.probe.plane.signed_distances(told_b[:3])) > 1e-5


def test_a_logbook_keeps_every_entry_and_drops_what_was_cut_off(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    T = np.eye(4)
    T[:3, 3] = rng.normal(size=3)
    turned = np.diag((1.0, -1.0, -1.0, 1.0))
    profile = Profile(np.array([0.1, np.nan, 0.3]), np.array([0.2, np.nan, 1 / 3]))
    file = tmp_path / f"{CALIBRATION_RECORDING_KIND}.mcap"
    with Logbook(tmp_path, TRUTH) as logbook:
        for entry in (
            BoardTouch(0, T),
            BoardTouch(1, None),
            BoardTouch(0, T @ turned),
            LaserLineTaken(PosedProfile("line 1", T, profile)),
            SkippedPose(T, "no line"),
            LaserLineTaken(PosedProfile("fresh", T, profile), for_verification=True),
        ):
            logbook.record(entry)
            on_disk = read_calibration_entries(tmp_path)
            assert kind(list(on_disk)[-1]) == kind(entry)
        written = logbook.measured
        whole = file.read_bytes()
        logbook.record(LaserLineTaken(PosedProfile("cut off", T, profile)))
    cut = whole + file.read_bytes()[len(whole) :][:300]
    file.write_bytes(cut)
    with Logbook(tmp_path, TRUTH) as logbook:
        found = logbook.measured
    assert file.read_bytes() == cut
    assert (tmp_path / f"{CALIBRATION_RECORDING_KIND}-2.mcap").exists()
    assert found.started_at == written.started_at
    assert found.touches[1].T_b_f is None
    np.testing.assert_array_equal(found.touches[0].T_b_f, T @ turned)
    assert [shot.name for shot in found.line_profiles] == ["line 1"]
    np.testing.assert_array_equal(found.line_profiles[0].profile.z_s, profile.z_s)
    assert [passed.reason for passed in found.skipped_poses] == ["no line"]
    assert found.skipped_in_a_row == 0  # whoever goes on may have changed what was wrong
    assert found.verification_profile is not None
    assert found.verification_profile.name == "fresh"


def test_every_part_shows_a_viewer_where_the_laser_sits_on_the_flange(tmp_path: Path) -> None:
    for name in (f"{CALIBRATION_RECORDING_KIND}.mcap", f"{CALIBRATION_RECORDING_KIND}-2.mcap"):
        with Logbook(tmp_path, TRUTH):
            pass
        (entry,) = read_messages(tmp_path / name, [TRANSFORMS_TOPIC])
        (frame,) = entry.message.transforms
        assert (frame.parent_frame_id, frame.child_frame_id) == ("f", "s")
        place = frame.translation
        assert (place.x, place.y, place.z) == tuple(TRUTH[:3, 3])


@pytest.mark.parametrize(
    ("name", "schema", "fields"),
    [
        ("/touch", "tjscan.BoardTouch", {}),
        ("/touch", "tjscan.BoardTouch", {"place_number": "first", "T_b_f": [], "q": []}),
        ("/touch", "tjscan.BoardTouch", {"place_number": 0, "T_b_f": [1.0] * 16, "q": []}),
        ("/touch", "tjscan.Joke", {"place_number": 0, "T_b_f": [], "q": []}),
        ("/begun", "tjscan.StartOrResumeEntry", {"date": "yesterday"}),
    ],
)
def test_a_damaged_recording_is_refused(
    tmp_path: Path, name: str, schema: str, fields: dict[str, Any]
) -> None:
    topic = raw_topic(name, schema)
    with RecordingWriter(tmp_path / f"{CALIBRATION_RECORDING_KIND}.mcap", [topic]) as recording:
        recording.write(0, (topic, fields))
    with pytest.raises(RecordingError, match="damaged"), Logbook(tmp_path, TRUTH):
        pass


def test_a_profile_without_its_line_is_refused(tmp_path: Path) -> None:
    with RecordingWriter(
        tmp_path / f"{CALIBRATION_RECORDING_KIND}.mcap", [PROFILE_TOPIC]
    ) as recording:
        recording.write(0, (PROFILE_TOPIC, PointCloud()))
    with (
        pytest.raises(RecordingError, match="a profile without a line"),
        Logbook(tmp_path, TRUTH),
    ):
        pass


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / f"{CALIBRATION_RECORDING_KIND}.mcap").write_text("nonsense", encoding="utf-8")
    with (
        pytest.raises(RecordingError, match="is no recording"),
        Logbook(tmp_path, TRUTH),
    ):
        pass


@given(count=st.integers(3, 40))
@settings(max_examples=20, deadline=None)
def test_places_span_the_board_and_keep_off_its_edges(count: int) -> None:
    job = read_calibration_job(JOB, {"board.touches": count})
    task = calibration_plan_of_job(job, TRUTH)
    places = task.touch_points @ inverse_pose(task.T_b_board)[:3, :3].T
    places += inverse_pose(task.T_b_board)[:3, 3]
    assert places.shape == (count, 3)
    assert (np.abs(places[:, :2]) < task.half_sizes).all()
    singular = np.linalg.svd(places - places.mean(axis=0))[1]
    assert singular[1] > 0.1
    assert singular[2] < 1e-12


@pytest.mark.parametrize(
    ("keys", "expected"), [("\r", True), ("\x1b[B\x1b[B\r", False), ("\x1b[B\r", True)]
)
def test_at_the_terminal_a_move_is_allowed_or_passed_over(
    monkeypatch: pytest.MonkeyPatch, keys: str, expected: bool
) -> None:
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    with create_pipe_input() as pipe, create_app_session(input=pipe, output=DummyOutput()):
        operator = TerminalOperator()
        pipe.send_text(keys)
        assert operator.confirm(Question("Move?", default=True, moves=True)) is expected
        if keys.count("[B") == 1:  # and don't ask again
            assert operator.confirm(Question("Move on?", default=True, moves=True))
        pipe.send_text("n")
        assert not operator.confirm(Question("Save?", default=True))
        pipe.send_text("\x03")
        with pytest.raises(KeyboardInterrupt):
            operator.confirm(Question("Save?", default=True))


@pytest.mark.parametrize(
    "home_deg", [[-150, -60, 80, -240, 20, 280], [-110, -95, 160, 105, -110, 0]]
)
def test_wherever_the_arm_stands_at_first_it_gets_there(
    tmp_path: Path, home_deg: list[float]
) -> None:
    """In the first of these, a wrist stands where many ways lead into its limit."""
    stage = Stage(tmp_path, simulation__arm__home_deg=home_deg, board__lines=12)
    assert stage.run(Watcher())[1].line_agrees


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([JOB], ["no terminal", "--unattended"]),
        ([PAPER, "--unattended"], ["board", "required"]),
        ([JOB, "--unattended", "--board.line", "6"], ["board.line", "lines"]),
        ([JOB, "--unattended", "--board.size-mm", "[20, 20]"], ["100 mm wide"]),
        ([JOB, "--unattended", "--calibration.file", "no.toml"], ["no.toml", "no such file"]),
        (["--resume", "nosuch", "--unattended"], ["nosuch", "no such file"]),
        (["nosuch.toml", "--unattended"], ["nosuch.toml", "no such file"]),
    ],
)
def test_bad_input_gets_one_message_and_leaves_nothing(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[object],
    words: list[str],
) -> None:
    monkeypatch.setattr(sys.stdin, "isatty", lambda: False, raising=False)
    out = [] if "--resume" in arguments else ["--out", tmp_path / "run"]
    assert tjscan("calibrate", *arguments, *out) == 2
    told = " ".join(capsys.readouterr().err.split())
    for word in words:
        assert word in told
    assert not (tmp_path / "run").exists()


def test_a_finished_calibration_is_neither_begun_nor_resumed_again(
    calibrated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {file: file.read_bytes() for file in calibrated.iterdir()}
    assert tjscan("calibrate", JOB, "--unattended", "--out", calibrated) == 2
    assert "--resume" in capsys.readouterr().err
    assert tjscan("calibrate", "--resume", calibrated, "--unattended") == 2
    assert "finished" in capsys.readouterr().err
    assert {file: file.read_bytes() for file in calibrated.iterdir()} == before


def test_a_refused_calibration_ends_with_one_and_writes_no_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rough = ["--simulation.laser.noise-mm", "1.5", "--unattended", "--out", tmp_path / "run"]
    assert tjscan("calibrate", JOB, *rough) == 1
    assert "calibration refused" in capsys.readouterr().err
    assert not (tmp_path / "run" / "calibration.toml").exists()
    assert entries(tmp_path / "run")
