"""The torch is where the laser's zero says, and where a person jogs it."""

import json
from dataclasses import replace
from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command import tjscan
from crawls import SHORT

from tjscan.cli.output.crawl import TerminalWeldOperator
from tjscan.core.errors import CrawlStopped
from tjscan.crawler.control_cycle import CrawlDevices, JointSensor
from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.plan import PassSettings
from tjscan.crawler.torch_axes import SimulatedTorchAxes, TorchJog
from tjscan.job.crawl.cell import make_crawl_cell
from tjscan.job.crawl.job import read_crawl_job
from tjscan.recording.journal import RunEvent
from tjscan.runs.crawl.run import CrawlContext, make_crawler
from tjscan.runs.live.crawl import JOG_STEP, jog_buttons

MM = 1e-3


class Notes:
    """A journal that keeps what it gets."""

    def __init__(self) -> None:
        self.cycles: list[CrawlCycle] = []
        self.events: list[RunEvent] = []

    def record(self, message: object) -> None:
        match message:
            case CrawlCycle():
                self.cycles.append(replace(message, profile=None))
            case RunEvent():
                self.events.append(message)


def crawl(tmp_path: Path, change: tuple[str, str] = ("", ""), jog: TorchJog | None = None) -> Notes:
    file, notes = tmp_path / "short.toml", Notes()
    file.write_text(SHORT.replace("run_up_mm = 30", "run_up_mm = 0").replace(*change))
    context = CrawlContext(read_crawl_job(file), file, jog=jog or TorchJog(0.0))
    cell = make_crawl_cell(context.job)
    with cell:
        make_crawler(context, cell, context.make_method(), notes).run()
    return notes


def test_places_count_from_the_zero_of_the_laser(tmp_path: Path) -> None:
    aside = "[torch]\naside_mm = 2.0\n[simulation]\ntorch_aside_mm = 2.0\n"
    (file := tmp_path / "short.toml").write_text(
        SHORT.replace("[simulation.vehicle]\n", aside + "[simulation.vehicle]\n")
    )
    context, notes = CrawlContext(read_crawl_job(file), file), Notes()
    cell = make_crawl_cell(context.job)
    with cell:
        make_crawler(context, cell, context.make_method(), notes).run()
    assert isinstance(cell.torch, SimulatedTorchAxes)
    assert notes.cycles[-1].torch_y == pytest.approx(cell.torch.y + 2 * MM, abs=1e-12)
    burning = [cycle for cycle in notes.cycles if cycle.arc]
    assert max(abs(cycle.deviation) for cycle in burning) < 0.1 * MM


def test_what_is_jogged_adds_up_to_its_limit_and_no_farther() -> None:
    jog = TorchJog(2 * MM)
    for _ in range(100):
        jog.move(0.05 * MM)
    assert jog.offset == 2 * MM
    jog.move(-9 * MM)
    assert jog.offset == -2 * MM


def test_what_was_jogged_is_in_the_record(tmp_path: Path) -> None:
    notes = crawl(tmp_path, jog=TorchJog(3 * MM, 1 * MM))
    burning = [cycle for cycle in notes.cycles if cycle.arc and cycle.number == 1]
    assert {cycle.jog for cycle in burning} == {1 * MM}
    assert {cycle.path for cycle in burning} == {1 * MM}  # so nothing counts as a deviation
    assert max(abs(cycle.deviation) for cycle in burning) < 0.1 * MM
    struck = next(event.detail for event in notes.events if event.name == "arc on")
    assert struck.endswith("jogged by +1.00 mm")


def test_a_page_jogs_while_a_button_is_held_if_the_job_lets_it() -> None:
    jog = TorchJog(3 * MM)
    left, right = jog_buttons(jog)
    for _ in range(3):
        right.press()
    left.press()
    assert jog.offset == pytest.approx(2 * JOG_STEP)
    assert left.held
    assert right.held
    assert not jog_buttons(TorchJog(0.0))


def test_millimetres_at_the_terminal_jog_and_are_no_consent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    answers = iter(["1.2", "nan", "-0.2", "n", "", "y"])
    asked = SimpleNamespace(unsafe_ask=lambda: next(answers))
    questions: list[str] = []

    def ask(question: str) -> SimpleNamespace:
        questions.append(question)
        return asked

    monkeypatch.setattr("questionary.text", ask)
    jog = TorchJog(3 * MM)
    operator = TerminalWeldOperator(jog)
    assert [operator.confirm_weld(1, "") for _ in range(3)] == [False] * 3
    assert not operator.confirm_weld(1, "the joint bends")
    assert "assumed that the joint bends: is it so?" in questions[3]
    assert not operator.confirm_weld(1, "the joint bends", looks=True)
    assert "weld pass 1" in questions[3]
    assert "with the arc out" in questions[4]
    assert "weld pass 1" not in questions[4]
    assert operator.confirm_torch()
    assert jog.offset == pytest.approx(1 * MM)


def test_a_torch_is_registered_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tjscan.runs.crawl.run.SHUTTLE_LENGTH", 0.06)
    file, found = tmp_path / "short.toml", []
    file.write_text(SHORT)
    for aside in (-2.0, 1.7):
        out = tmp_path / f"run{aside}"
        keys = "--simulation.torch-aside-mm", str(aside), "--json", "--out", out
        assert tjscan("crawl", "register", file, *keys) == 0
        found.append(json.loads(capsys.readouterr().out))
        assert abs(found[-1]["aside_mm"] - aside) < 4 * found[-1]["sigma_mm"]
    # All but the torch was alike: so what the two differ by is what its places differ by.
    apart = found[1]["aside_mm"] - found[0]["aside_mm"]
    assert apart == pytest.approx(3.7, abs=0.2)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (("--torch.driver", "none"), "can't be jogged over the joint"),
        (("--simulation.torch-aside-mm", "40"), "beside what it reaches"),
        (("--guards.torch-sigma-mm", "0.6"), "no arc is struck above guards.torch_sigma_mm = "),
    ],
)
def test_a_torch_that_cannot_be_registered_is_not(
    keys: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr("tjscan.runs.crawl.run.SHUTTLE_LENGTH", 0.06)
    file = tmp_path / "short.toml"
    file.write_text(SHORT)
    assert tjscan("crawl", "register", file, *keys, "--out", tmp_path / "run") != 0
    assert said in " ".join(capsys.readouterr().err.split())


class Reader:
    """Reads one width after another."""

    def __init__(self, *widths: float) -> None:
        self._widths = iter(widths)

    def read(self, profile: Any, travel: float) -> Any:
        return SimpleNamespace(centre=0.0, width=next(self._widths))


def sensor(*widths: float) -> JointSensor:
    laser = SimpleNamespace(capture=lambda: SimpleNamespace(time=0.0))
    devices: Any = CrawlDevices(laser, laser, laser, Reader(*widths), laser_to_torch=0.5)
    return JointSensor(devices, Notes())


def test_the_width_of_a_place_is_what_was_read_there() -> None:
    joint = sensor(0.030, 0.032, nan, 0.036)
    for travel in (-0.3975, -0.3975, -0.39, -0.3875):  # the laser at 102.5, 110, 112.5 mm
        joint.look(travel)
    places = np.array((0.0, 0.1025, 0.1075, 0.1125, 0.5))
    found = [joint.width_at(place) for place in places.tolist()]
    np.testing.assert_allclose(found, (0.031, 0.031, 0.0335, 0.036, 0.036), atol=1e-9)


def test_a_joint_without_edges_is_not_woven_by_them() -> None:
    with pytest.raises(CrawlStopped, match="edge_gap_mm"):
        sensor().width_at(0.1)


def test_a_weave_turns_inside_of_the_edges_that_were_read(tmp_path: Path) -> None:
    notes = crawl(tmp_path, ("weave_mm = 2", "edge_gap_mm = 3"))
    path = np.array([cycle.path for cycle in notes.cycles if cycle.arc and cycle.number == 2])
    assert path.max() == pytest.approx(12 * MM, abs=0.3 * MM)  # of a joint that is 30 mm wide
    assert path.min() == pytest.approx(-12 * MM, abs=0.3 * MM)


def test_a_weave_ends_by_one_thing_alone() -> None:
    with pytest.raises(ValueError, match="state no weave_mm"):
        PassSettings(edge_gap=3 * MM, weave=2 * MM)
    with pytest.raises(ValueError, match="no time to swing"):
        PassSettings(edge_gap=3 * MM, weave_period=1.0, dwell=0.5)
