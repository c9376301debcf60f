"""The acceptance of a cell: what is as stated passes, what is not fails by its own row."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import EXAMPLES
from command import tjscan

from tjscan.calibration.wizard.operator import DefaultAnswerOperator, Question
from tjscan.core.errors import AcceptanceRefused, ConfigurationError
from tjscan.core.frames import pose
from tjscan.job.files import read_acceptance_job
from tjscan.robot.arm import ArmState
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.simulated import SimulatedArm
from tjscan.runs.accept import run
from tjscan.runs.accept.judge import AcceptanceRow, clock_drift, stopping
from tjscan.runs.accept.measure import stop_half_way

JOB = EXAMPLES / "accept.toml"
HOME = np.radians((180.0, -90.0, 90.0, -90.0, -90.0, 0.0))
FEW = {"accept.returns": 10, "accept.postures": 10}
BAR = FEW | {
    "artefact.kind": "ball bar",
    "artefact.second_mm": [600.0, -100.0, 150.0],
    "artefact.distance_mm": 200.0,
    "artefact.distance_expanded_mm": 0.002,
}
"""In simulation the second ball truly is so far from the first one."""


@pytest.fixture(scope="module")
def accepted(tmp_path_factory: pytest.TempPathFactory) -> tuple[run.Acceptance, Path, run.Measured]:
    """An acceptance without a fault, where it was written, and what was measured."""
    directory = tmp_path_factory.mktemp("accepted") / "first"
    taken: list[run.Measured] = []
    take = run.Measured.take

    def keep(*inputs: Any) -> run.Measured:
        taken.append(take(*inputs))
        return taken[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run.Measured, "take", keep)
        job = read_acceptance_job(JOB, BAR)
        found = run.accept_cell(job, JOB, directory, DefaultAnswerOperator())
    return found, directory, taken[0]


def test_a_cell_that_is_as_stated_is_accepted_and_recorded(
    accepted: tuple[run.Acceptance, Path, run.Measured],
) -> None:
    found, directory, _ = accepted
    assert found.passes
    measured = {row.key: row for row in found.rows}
    assert set(measured) >= {"clock", "repeatability", "linearity", "noise", "calibration"}
    assert abs(measured["clock"].measured - 50.0) < 10  # as the simulated laser's does
    assert abs(measured["distance"].measured - 200.0) < 0.1
    assert abs(measured["place x"].measured - 604.0) < 0.05
    record = json.loads((directory / "acceptance.json").read_text(encoding="utf-8"))
    assert record["artefact"]["certificate"] == "simulated-1"
    assert record["passes"]
    assert all(row["passes"] for row in record["rows"])
    assert (record["arm"], record["laser"]) == ("ur10e", "simulated")
    assert (directory / "accept.mcap").stat().st_size > 1e5


def test_what_is_wrong_fails_by_its_own_row(
    accepted: tuple[run.Acceptance, Path, run.Measured],
) -> None:
    _, _, measured = accepted

    def failing(keys: dict[str, object], mount: tuple[float, ...] = (0.0, 0.0, 0.0)) -> set[str]:
        stated = measured.grid.stated
        stated = replace(stated, T_f_s=stated.T_f_s @ pose(p=mount))
        job = read_acceptance_job(JOB, BAR | keys)
        return {row.key for row in measured.rows(job, stated) if not row.passes}

    assert failing({}) == set()
    assert failing({"artefact.radius_mm": 30.212}) == {"radius"}
    assert failing({"artefact.distance_mm": 200.3}) == {"distance"}
    assert failing({}, (0.5e-3, 0.0, 0.0)) == {"calibration"}
    assert failing({}, (0.0, 0.0, -0.5e-3)) == {"calibration"}
    assert failing({"accept.clock_drift_ppm": 20.0}) == {"clock"}
    assert failing({"ball.noise.range_mm": 0.015}) == {"noise"}


def test_the_same_again_shows_drift_in_sigmas_and_who_measured(
    accepted: tuple[run.Acceptance, Path, run.Measured], tmp_path: Path
) -> None:
    found, directory, _ = accepted
    job = read_acceptance_job(JOB, FEW)
    earlier = run.read_earlier_acceptance(directory.parent, job)
    assert earlier == found == run.read_earlier_acceptance(directory, job)
    assert found == run.read_earlier_acceptance(directory / "acceptance.json", job)
    worn = tuple(
        replace(row, measured=row.measured + 4 * np.sqrt(2) * row.sigma)
        if row.key == "radius"
        else row
        for row in found.rows
    )
    later = replace(found, rows=worn).compared_with(earlier)
    drifted = [row for row in later.rows if row.has_drifted]
    assert [row.key for row in drifted] == ["radius"]
    assert drifted[0].drift == pytest.approx(4.0)
    assert not later.passes
    assert tjscan("accept", JOB, "--against", directory, "--arm.id", "another") == 2


def test_of_a_folder_the_first_acceptance_that_passed_counts(
    accepted: tuple[run.Acceptance, Path, run.Measured], tmp_path: Path
) -> None:
    found, directory, _ = accepted
    record = json.loads((directory / "acceptance.json").read_text())

    def put(name: str, day: int, *, passes: bool) -> None:
        rows = [row | ({} if passes else {"measured": 1e3}) for row in record["rows"]]
        (tmp_path / name).mkdir()
        text = json.dumps(record | {"date": f"2026-01-{day:02d}T08:00:00Z", "rows": rows})
        (tmp_path / name / "acceptance.json").write_text(text)

    job = read_acceptance_job(JOB, FEW)
    for day, name in enumerate(("failed", "again"), start=1):
        put(name, day, passes=False)
    with pytest.raises(ConfigurationError, match="none of its acceptances passed"):
        run.read_earlier_acceptance(tmp_path, job)
    assert run.read_earlier_acceptance(tmp_path / "failed", job).date.day == 1
    for day, name in enumerate(("passed", "later"), start=3):
        put(name, day, passes=True)
    assert run.read_earlier_acceptance(tmp_path, job).date.day == 3
    assert found.passes


def test_another_ball_is_no_drift_and_what_was_not_measured_has_none(
    accepted: tuple[run.Acceptance, Path, run.Measured],
) -> None:
    found, _, _ = accepted
    larger = {"radius": 5.0, "place x": 20.0}
    rows = tuple(
        replace(
            row,
            measured=row.measured + larger.get(row.key, 0.0),
            nominal=row.nominal + (5.0 if row.key == "radius" else 0.0),
        )
        for row in found.rows
    )
    other = replace(found, rows=rows, artefact=found.artefact | {"certificate": "another"})
    drifts = {row.key: row.drift for row in other.compared_with(found).rows}
    assert drifts["radius"] == pytest.approx(0.0, abs=1e-6)
    assert drifts["place x"] is None
    first = replace(found, rows=found.rows[:1])
    assert all(row.drift is None for row in found.compared_with(first).rows[1:])


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        (("--artefact.date", "2030-01-01"), "in the future"),
        (("--artefact.valid-until", "2026-01-13"), "expired"),
        (("--artefact.kind", "ball bar"), "second_mm"),
        (("--artefact.radius-mm", "60"), "a diameter"),
        (("--artefact.radius-expanded-mm", "0"), "artefact.radius_expanded_mm"),
        (("--calibration", "x"), "unknown option"),
        (("--arm.driver", "replay"), "arm.driver"),
    ],
)
def test_bad_input_is_refused_by_name_and_nothing_is_made(
    keys: tuple[str, ...], named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert tjscan("accept", JOB, "--unattended", "--out", out, *keys) == 2
    assert named in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("lines", "named"),
    [("sigma_", "calibration"), ("radius_expanded", "artefact.radius_expanded_mm")],
)
def test_certainty_that_is_not_stated_is_refused(
    lines: str, named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = JOB.read_text(encoding="utf-8").splitlines()
    file = tmp_path / "job.toml"
    file.write_text("\n".join(line for line in text if not line.startswith(lines)))
    assert tjscan("accept", file, "--unattended", "--out", tmp_path / "out") == 2
    assert f"{named}: " in capsys.readouterr().err


def test_a_ball_that_is_elsewhere_is_not_seen(tmp_path: Path) -> None:
    job = read_acceptance_job(JOB, {"ball.position_mm": [640.0, -400.0, 150.0]})
    with pytest.raises(AcceptanceRefused, match="not seen"):
        run.accept_cell(job, JOB, tmp_path / "out", DefaultAnswerOperator())


def test_nothing_moves_without_consent(tmp_path: Path) -> None:
    asked: list[Question] = []

    class Refusing(DefaultAnswerOperator):
        present = True

        def confirm(self, question: Question) -> bool:
            asked.append(question)
            return False

    job = read_acceptance_job(JOB, FEW)
    with pytest.raises(AcceptanceRefused, match="not begun"):
        run.accept_cell(job, JOB, tmp_path / "out", Refusing())
    assert [question.moves for question in asked] == [True]


def test_a_row_fails_where_it_is_proven_to_be_beyond_its_limit() -> None:
    row = AcceptanceRow("", "", "mm", 1.0, 0.1, 0.5, "", 0.3)
    assert row.passes  # 0.2 beyond, which is two standard uncertainties
    assert not replace(row, sigma=0.05).passes
    assert replace(row, sigma=0.05, limit=None).passes
    assert replace(row, measured=-0.1, sigma=0.0).passes


def test_a_stopping_distance_is_that_of_the_braking() -> None:
    speed, braking, period = 0.25, 1.2, 0.002
    times = np.arange(0.0, 1.0, period)
    brake = np.clip(times - 0.4, 0.0, speed / braking)
    x = speed * np.minimum(times, 0.4) + speed * brake - 0.5 * braking * brake**2
    states = [
        ArmState(np.zeros(6), pose(p=(a, 0.0, 0.0)), t) for a, t in zip(x, times, strict=True)
    ]
    distance, sigma, seen = stopping(states, 200)
    assert seen == pytest.approx(speed, rel=1e-6)
    assert distance == pytest.approx(speed**2 / (2 * braking), abs=1e-5)
    assert sigma == pytest.approx(speed * period / np.sqrt(12), rel=0.02)


def test_an_arm_is_stopped_on_its_way_and_moves_again() -> None:
    arm = SimulatedArm(Kinematics.load("ur10e"), HOME, realtime=True)
    with arm:
        start = arm.state().T_b_f
        there = pose(p=(0.0, 0.0, -0.1)) @ start
        states, ordered = stop_half_way(arm, there)
        assert 0 < ordered < len(states) - 1
        left = np.linalg.norm(arm.state().T_b_f[:3, 3] - there[:3, 3])
        assert left > 0.01
        assert np.allclose(arm.move_linear(there).T_b_f, there, atol=1e-6)
        arm.realtime = False  # its moves end at once: there is no stop on the way
        assert stop_half_way(arm, start) == ([], 0)


def test_clocks_that_run_apart_are_told_with_their_sign() -> None:
    laser_fast = 1e-4
    first = (0.0, 5.0, 1e-4)
    last = (100.0 * (1 + laser_fast), 5.0 - 100.0 * laser_fast, 1e-4)
    drift, sigma = clock_drift(first, last)
    assert drift == pytest.approx(laser_fast, rel=1e-3)
    assert sigma == pytest.approx(np.sqrt(2) * 1e-6, rel=1e-3)
