"""A whole crawl in a simulated world: run, stopped, resumed, compared, refused."""

import csv
import json
import tomllib
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from cells import EXAMPLES
from command import tjscan
from crawls import SHORT

from tjscan.core.errors import CrawlStopped
from tjscan.crawler.crawler import MOST_RUN_UPS
from tjscan.crawler.joint_sections import COASTING_TIME
from tjscan.crawler.journal import CRAWL_RECORDING, WARNING_EVENT, CrawlCycle, CrawlRecording
from tjscan.crawler.method import TorchEstimate
from tjscan.crawler.pass_record import root_mean_square
from tjscan.crawler.phases import Phase
from tjscan.crawler.slip_estimator import MOST_SIDEWAYS_SHARE, STATE_COUNT, SlipEstimate
from tjscan.job.crawl.cell import CrawlCell, InterruptedWorld, make_crawl_cell
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.recording.journal import RunEvent
from tjscan.recording.parts import next_recording_file
from tjscan.runs.crawl.report import crawl_chapter
from tjscan.runs.crawl.results import read_recorded_crawl, weld_log
from tjscan.runs.crawl.run import (
    CrawlContext,
    find_start_after_stop,
    resume_crawl,
    run_crawl,
    short_pass_warning,
    slip_after_stop,
)
from tjscan.vehicle.vehicle import AT_REST, DEAD_MAN_TIME, Twist, VehicleState


class InterruptedInWeld:
    """A journal that interrupts the crawl where the arc has burned for a while."""

    def __init__(self, travel: float) -> None:
        self._travel = travel

    def record(self, message: object) -> None:
        if isinstance(message, CrawlCycle) and message.arc and message.travel > self._travel:
            raise KeyboardInterrupt


@pytest.fixture
def job_file(tmp_path: Path) -> Path:
    file = tmp_path / "short.toml"
    file.write_text(SHORT)
    return file


def rows(directory: Path) -> list[dict[str, str]]:
    lines = (directory / "passes.csv").read_text().splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def test_a_job_is_welded_pass_by_pass(job_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert tjscan("crawl", "run", job_file, "--out", out) == 0
    table = rows(out)
    assert [row["pass"] for row in table] == ["1", "2"]
    for row in table:
        assert float(row["length_mm"]) == pytest.approx(30, abs=0.5)
        assert float(row["speed_mm_s"]) == pytest.approx(20, rel=0.02)
        assert float(row["profiles_read_percent"]) == 100
    log = json.loads((out / "weld-log.json").read_text())
    assert [one["procedure"] for one in log["passes"]] == ["WPS-1", "WPS-2"]
    assert (log["stops"], log["bends_assumed"]) == ([], [])
    found = read_recorded_crawl(out)
    slip = next(one.slip for one in reversed(found.cycles) if one.slip is not None)
    bent = replace(found.cycles[-1], slip=slip.with_bend((), 0.5))
    (bend,) = weld_log(out, read_crawl_job(out / "job.toml"), replace(found, cycles=(bent,)))[
        "bends_assumed"
    ]
    assert bend["to"]["value"] - bend["from"]["value"] == pytest.approx(490)
    assert {one["source"] for one in bend.values()} == {"believed"}
    (recording,) = log["recordings"]
    assert recording["sha256"] == sha256((out / recording["file"]).read_bytes()).hexdigest()
    report = (out / "report.html").read_text()
    assert "pass 2" in report
    assert "60 mm with its run-up, is shorter" in report
    phases = [cycle.phase for cycle in read_recorded_crawl(out).cycles]
    assert set(phases) == set(Phase) - {Phase.STOP}
    assert tjscan("crawl", "compare", out, out) == 0
    assert tjscan("report", out) == 0
    assert tjscan("crawl", "run", out, "--resume") == 2  # nothing is left to do


def test_no_arc_is_struck_where_the_torch_is_not_known(job_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    code = tjscan("crawl", "run", job_file, "--guards.torch-sigma-mm", "0.01", "--out", out)
    assert code == 4
    found = read_recorded_crawl(out)
    assert not any(cycle.arc for cycle in found.cycles)
    run_ups = [event.name for event in found.events].count(Phase.WELDING)
    assert run_ups == MOST_RUN_UPS
    assert "needs 0.01 mm" in found.events[-1].detail


def test_a_joint_is_filled_to_its_cap(job_file: Path, tmp_path: Path) -> None:
    """The laser close to the torch sees in each pass what the last one left; at last no edge."""
    beads = [(15, 0.5, 1.0), (18.5, 0.5, 1.0), (20, 2, 1.1)]
    levels = [
        {"level_mm": level, "crown_mm": crown, "left": -side, "right": side}
        for level, crown, side in beads
    ]
    keys = {
        "vehicle.laser_to_torch_mm": 30,
        "weld.length_m": 0.04,
        "pass": [{"speed_mm_s": 20}] * 3,
        "simulation.joint.beads": levels,
        "simulation.arc_points_percent": 20,
    }
    out = tmp_path / "run"
    run_crawl(CrawlContext(read_crawl_job(job_file, keys), job_file), out)
    found = read_recorded_crawl(out)
    assert found.events[-1].name == Phase.MANUAL
    capped = found.passes[2]
    assert capped.read_share > 0.9
    assert root_mean_square(capped.true_deviation) < 0.2e-3


def test_what_was_cut_short_goes_on_with_an_overlap(job_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    job = read_crawl_job(job_file)
    with pytest.raises(KeyboardInterrupt):
        run_crawl(CrawlContext(job, job_file, InterruptedInWeld(0.015)), out)
    cut = read_recorded_crawl(out)
    assert cut.events[-1].name == Phase.STOP
    assert cut.passes[0].length == pytest.approx(0.015, abs=1e-3)

    file = out / "job.toml"
    resume_crawl(CrawlContext(read_crawl_job(file), file), overlap=0.005)
    found = read_recorded_crawl(out)
    assert [one.number for one in found.passes] == [1, 2]
    first = found.passes[0]
    assert first.stops == 1
    assert first.arcs[1][0] == pytest.approx(first.arcs[0][1] - 0.005, abs=1e-3)
    assert first.length == pytest.approx(0.030, abs=1e-3)
    # It goes on from where it stood: its place along the joint does not jump.
    steps = np.abs(np.diff([cycle.travel for cycle in found.cycles]))
    assert steps.max() < 2e-3
    assert len(json.loads((out / "weld-log.json").read_text())["recordings"]) == 2


@pytest.fixture
def cut_short(job_file: Path, tmp_path: Path) -> Path:
    """Directory of a crawl that was interrupted in its first pass."""
    out = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        run_crawl(CrawlContext(read_crawl_job(job_file), job_file, InterruptedInWeld(0.015)), out)
    return out


def test_a_report_says_what_was_not_welded_and_what_was_cut_off(cut_short: Path) -> None:
    said = crawl_chapter(cut_short).findings
    assert "1 of 2 passes are not welded." in said
    assert "Pass 1 is not whole: 15.0 of 30 mm are welded." in said
    resume_crawl(CrawlContext(read_crawl_job(cut_short / "job.toml"), cut_short / "job.toml"))
    assert not any("not w" in words for words in crawl_chapter(cut_short).findings)
    recording = cut_short / "crawl-2.mcap"
    data = recording.read_bytes()
    recording.write_bytes(data[: int(0.95 * len(data))])  # on the way back from the last pass
    assert any("ends in the phase 'return'" in words for words in crawl_chapter(cut_short).findings)


def moved_by_hand(monkeypatch: pytest.MonkeyPatch, *by: float) -> None:
    """Let a vehicle that goes on stand elsewhere, by x, y in metres and an angle."""

    def make_moved_cell(job: CrawlJob, left: InterruptedWorld, *rest: object) -> CrawlCell:
        return make_crawl_cell(job, replace(left, pose_w=left.pose_w + np.array(by)))

    monkeypatch.setattr("tjscan.runs.crawl.run.make_crawl_cell", make_moved_cell)


@pytest.mark.parametrize(
    ("by", "evidence"),
    [
        ((0.0, 3e-3, 0.0), "3.0 mm aside"),
        ((0.0, 0.0, 5e-3), "2.5 mm aside"),
        ((0.1, 0.0, 0.0), "looks different"),  # a tack lies there
    ],
)
def test_a_vehicle_that_was_moved_since_does_not_go_on(
    cut_short: Path, monkeypatch: pytest.MonkeyPatch, by: tuple[float, ...], evidence: str
) -> None:
    before = read_recorded_crawl(cut_short)
    moved_by_hand(monkeypatch, *by)
    job = cut_short / "job.toml"
    tack = {"at_m": 0.615, "length_mm": 40, "height_mm": 6}
    parsed = read_crawl_job(job, {"simulation.joint.tacks": [tack]})
    for _ in range(2):  # that it was refused once says nothing new of where it stands
        with pytest.raises(CrawlStopped, match=evidence) as stopped:
            resume_crawl(CrawlContext(parsed, job))
        assert stopped.value.guard == "moved"
        moved_by_hand(monkeypatch, 0.0, 0.0, 0.0)
    found = read_recorded_crawl(cut_short)
    assert all(cycle.commanded == AT_REST for cycle in found.cycles[len(before.cycles) :])


def test_a_vehicle_that_was_moved_goes_on_from_where_its_operator_says(
    cut_short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = read_recorded_crawl(cut_short).cycles[-1].travel
    moved_by_hand(monkeypatch, 0.02, 3e-3, 5e-3)
    job = cut_short / "job.toml"
    resume_crawl(CrawlContext(read_crawl_job(job), job), overlap=0.005, place=at + 0.02)
    found = read_recorded_crawl(cut_short)
    assert "as the operator states" in next(e.detail for e in found.events if e.name == "set-down")
    first = found.passes[0]
    assert [one.number for one in found.passes] == [1, 2]
    burned = np.diff(np.sort(first.true_travel))
    assert burned.max() < 2e-3  # no gap
    assert first.true_travel.max() == pytest.approx(0.03, abs=1e-3)


@pytest.mark.parametrize("options", [("--resume", "--place", "3000"), ("--place", "3")])
def test_a_place_that_can_not_be_is_refused(
    cut_short: Path, job_file: Path, options: tuple[str, ...]
) -> None:
    where = cut_short if "--resume" in options else job_file
    assert tjscan("crawl", "run", where, *options) == 2


def test_a_job_that_lost_a_pass_since_is_not_gone_on_with(
    job_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    class InterruptedInSecond(InterruptedInWeld):
        def record(self, message: object) -> None:
            if isinstance(message, CrawlCycle) and message.number == 2:
                super().record(message)

    out = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        run_crawl(CrawlContext(read_crawl_job(job_file), job_file, InterruptedInSecond(0.01)), out)
    job = tomllib.loads((out / "job.toml").read_text())
    (out / "job.toml").write_text(tomli_w.dumps({**job, "pass": job["pass"][:1]}))
    before = sorted(out.iterdir())
    assert tjscan("crawl", "run", out, "--resume") == 2
    assert "pass 2 was begun, and the job has 1" in capsys.readouterr().err
    assert sorted(out.iterdir()) == before


def test_before_the_end_of_the_steel_it_stops(job_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    end = 400  # of the steel: half the vehicle's length ahead of where it starts is 370
    steel = f"[[-2000, -1000], [{end}, -1000], [{end}, 1000], [-2000, 1000]]"
    code = tjscan("crawl", "run", job_file, "--simulation.vehicle.steel-mm", steel, "--out", out)
    assert code == 4
    found = read_recorded_crawl(out)
    assert found.events[-1].name == Phase.STOP
    assert "no steel" in found.events[-1].detail
    assert max(cycle.travel for cycle in found.cycles) + 0.4 < 1e-3 * end + 0.03
    assert (out / "report.html").exists()


def test_a_calibration_is_learned_and_holds_for_its_vehicle_alone(
    job_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tjscan.runs.crawl.run.SHUTTLE_LENGTH", 0.06)
    monkeypatch.setattr("tjscan.runs.crawl.run.SHUTTLE_COUNT", 1)
    out = tmp_path / "shuttle"
    assert tjscan("crawl", "calibrate", job_file, "--out", out) == 0
    calibrated = tmp_path / "calibrated.toml"
    calibrated.write_text('calibration = "shuttle/calibration.toml"\n' + SHORT)
    assert read_crawl_job(calibrated).calibration is not None
    first = CrawlContext(read_crawl_job(calibrated), calibrated).initial_slip
    unknown = CrawlContext(read_crawl_job(job_file), job_file).initial_slip
    learned = np.diag(unknown.P)[2:6] - np.diag(first.P)[2:6]
    assert (learned > 0).all()
    code = tjscan("crawl", "run", calibrated, "--vehicle.id", "crawler-2", "--out", tmp_path / "x")
    assert code == 2
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("--course.radius-m", "3"),  # tighter than the vehicle turns
        ("--weld.lenght-m", "1"),
        ("--steering.gain-per-m", "-1"),
        ("--simulation.joint.width-mm", "500"),
        ("--simulation.joint.width-mm", "100"),  # wider than the laser's line
        ("--simulation.joint.width-mm", "79"),  # hardly any hull beside it
        ("--torch.reach-mm", "1.5"),  # a pass weaves by more
        ("--vehicle.driver", "replay"),
        ("--size.torque-n-m", "42"),  # the paper's motors
        ("--guards.torque-n-m", "42"),  # motors that would do, and a guard that lets them not
        ("--size.pads.pads", "12"),  # one track alone does not hold it
    ],
)
def test_a_job_that_can_not_be_is_refused(
    job_file: Path, tmp_path: Path, key: str, value: str
) -> None:
    assert tjscan("crawl", "run", job_file, key, value, "--out", tmp_path / "x") == 2
    assert not (tmp_path / "x").exists()


def test_a_turn_that_the_motors_can_not_do_is_refused_in_a_line_that_says_which_they_can(
    job_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tight = ("--size.torque-n-m", "76.5", "--steering.least-radius-mm", "5000")
    assert tjscan("crawl", "run", job_file, *tight, "--out", tmp_path / "x") == 2
    assert "torque of a turn of 5 m" in capsys.readouterr().err
    weak = ("--size.torque-n-m", "60")
    for command in ("run", "calibrate"):
        assert tjscan("crawl", command, job_file, *weak, "--out", tmp_path / "x") == 2
        said = capsys.readouterr().err.strip()
        assert "\n" not in said
        assert "torque of a turn of 8 m is 75.8 N m, and must be at most 60" in said
        assert "steering.least_radius_mm" in said
    assert not (tmp_path / "x").exists()


def test_a_wrong_key_of_a_pass_is_told_by_the_number_of_the_pass(
    job_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("crawl", "size", job_file, "--pass.1.speed-mm-s", "-1") == 2
    assert "pass number 2: " in capsys.readouterr().err


def test_the_example_has_ways_long_enough() -> None:
    file = Path(__file__).parents[2] / "examples" / "crawl.toml"
    context = CrawlContext(read_crawl_job(file), file)
    assert short_pass_warning(context.job, context.initial_slip) == ""
    assert short_pass_warning(context.job, None) == ""


def test_a_bend_to_the_other_side_is_refused(job_file: Path, tmp_path: Path) -> None:
    bends = ("--course.radius-m", "20", "--simulation.joint.radius-m", "-20")
    assert tjscan("crawl", "run", job_file, *bends, "--out", tmp_path / "x") == 2
    assert not (tmp_path / "x").exists()


def test_a_directory_that_can_not_be_made_is_told(
    job_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tjscan("crawl", "run", job_file, "--out", job_file / "run") == 1
    assert "can't be made" in capsys.readouterr().err


def test_a_sizing_says_which_rule_is_broken(
    job_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wide = ("--steering.least-radius-mm", "1000000")
    assert tjscan("crawl", "size", job_file, *wide, "--json") == 0
    assert all(one["holds"] for one in json.loads(capsys.readouterr().out))
    # Magnets in all, not of each track: then one track alone does not hold it.
    assert tjscan("crawl", "size", job_file, *wide, "--size.pads.pads", "12", "--json") == 3
    broken = [one["name"] for one in json.loads(capsys.readouterr().out) if not one["holds"]]
    assert broken == ["the same with one track broken", "friction needed on one track"]


def write_parts(directory: Path, *names: str) -> None:
    """Write parts of a recording: each crawls 9 cycles, or waits for as many, and then ends."""
    for name in names:
        waits = name.startswith("waits")
        with CrawlRecording(next_recording_file(directory, CRAWL_RECORDING)) as journal:
            journal.record(RunEvent(WARNING_EVENT, "anything else"))
            for k in range(9):
                phase = Phase.MANUAL if waits else Phase.WELDING
                state = VehicleState(0.1 * k, Twist(0.02, 0.0))
                torch = TorchEstimate(0.0, 1e-3, 0.0)
                slip = SlipEstimate(np.zeros(STATE_COUNT), np.eye(STATE_COUNT))
                journal.record(
                    CrawlCycle(
                        phase, 1, 0.01 * k, state, AT_REST, torch, 0.0, 0.0, not waits, slip=slip
                    )
                )
            if name.endswith("stop"):
                journal.record(RunEvent(Phase.STOP, "interrupted"))


@pytest.mark.parametrize(
    ("parts", "stopped"),
    [
        (("stop",), True),
        (("killed",), False),
        (("killed", "waits, stop"), False),  # nobody knows more of where the first one ended
        (("stop", "waits, killed"), True),
        (("stop", "killed"), False),
        (("killed", "stop"), True),
    ],
)
def test_how_it_ended_is_told_by_what_crawled_last(
    tmp_path: Path, parts: tuple[str, ...], *, stopped: bool
) -> None:
    write_parts(tmp_path, *parts)
    found = read_recorded_crawl(tmp_path)
    assert found.was_stopped is stopped
    belief = slip_after_stop(found, read_crawl_job(EXAMPLES / "crawl.toml"))
    assert belief is not None
    seconds = DEAD_MAN_TIME if stopped else COASTING_TIME
    assert belief.P[0, 0] - 1 == pytest.approx((MOST_SIDEWAYS_SHARE * 0.02 * seconds) ** 2)


def test_the_way_since_a_belief_was_recorded_is_doubted(tmp_path: Path) -> None:
    """As earlier versions recorded it, every 50 cycles."""
    write_parts(tmp_path, "stop")
    found = read_recorded_crawl(tmp_path)
    old = tuple(replace(cycle, slip=found.cycles[-1].slip) for cycle in found.cycles)
    estimate = slip_after_stop(replace(found, cycles=old), read_crawl_job(EXAMPLES / "crawl.toml"))
    assert estimate is not None
    assert estimate.P[0, 0] - 1 == pytest.approx(
        (MOST_SIDEWAYS_SHARE * (0.08 + 0.02 * DEAD_MAN_TIME)) ** 2
    )


def test_a_place_that_was_told_to_a_crawl_that_never_went_on_is_none(tmp_path: Path) -> None:
    """A mistyped --place, interrupted before anything moved, says nothing of where it stands."""
    write_parts(tmp_path, "stop", "waits, stop")
    cycles = [
        replace(cycle, travel=3.0) if cycle.phase is Phase.MANUAL else cycle
        for cycle in read_recorded_crawl(tmp_path).cycles
    ]
    job = read_crawl_job(EXAMPLES / "crawl.toml")
    assert find_start_after_stop(cycles, job, 0.02, tmp_path).travel == pytest.approx(0.08)
