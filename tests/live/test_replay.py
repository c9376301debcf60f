"""A recording on the page: what its slider shows is what was known then."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from _live_client import page_client
from command import tjscan

from tjscan.core.errors import ConfigurationError
from tjscan.live.drawables import MeasuredPiece
from tjscan.live.page import PageAddress, Replay
from tjscan.live.step import RecordedShow
from tjscan.runs.tasks import read_recorded_show

RUN = Path(__file__).parents[1] / "data" / "run-0.1.0"


@pytest.fixture(scope="module")
def show() -> RecordedShow:
    return read_recorded_show(RUN)


@pytest.fixture(scope="module")
def replay(show: RecordedShow) -> Iterator[Replay]:
    replay = Replay([show], PageAddress(port=0))
    with replay.page:
        yield replay


def pieces(show: RecordedShow) -> dict[str, MeasuredPiece]:
    return {
        name: thing
        for step in show.steps
        for name, thing in step.drawn.items()
        if isinstance(thing, MeasuredPiece)
    }


def test_every_section_is_a_piece_with_its_measures(show: RecordedShow) -> None:
    names = {measure.name for measure in show.setting.measures}
    found = pieces(show)
    assert len(found) == len([step for step in show.steps if step.samples]) >= 3
    for piece in found.values():
        assert names == piece.values.keys()
        assert np.isfinite(list(piece.values.values())).all()
    assert all(0 <= one.x <= 12 for step in show.steps for one in step.samples)


def test_a_browser_gets_all_of_it(show: RecordedShow, replay: Replay) -> None:
    replay.move_to_step(len(show.steps) - 1)
    with page_client(replay.page) as client:
        client.receive()
    assert {f"/run/{name}/points" for name in pieces(show)} <= client.names()
    assert {
        "/run/arm/forearm_link/body",
        "/run/laser",
        "/run/fitted",
        "/run/ghost/0",
    } <= client.names()


def test_the_slider_hides_what_came_later(show: RecordedShow, replay: Replay) -> None:
    stage = replay.page.views[0].stage
    first = next(k for k, step in enumerate(show.steps) if step.samples)
    for number, seen in ((first, 1), (0, 0), (len(show.steps) - 1, len(pieces(show)))):
        replay.move_to_step(number)
        shown = [name for name in pieces(show) if all(n.visible for n in stage.nodes[name])]
        assert len(shown) == seen
        assert len(replay.page.views[0].panel.samples) == seen


def test_the_slider_takes_back_what_was_said_later(show: RecordedShow, replay: Replay) -> None:
    panel = replay.page.views[0].panel
    replay.move_to_step(len(show.steps) - 1)
    assert "groove angle" in panel.state.content
    replay.move_to_step(0)
    assert "groove angle" not in panel.state.content


def test_moving_the_slider_sends_no_piece_twice(show: RecordedShow, replay: Replay) -> None:
    last = len(show.steps) - 1
    replay.move_to_step(last)
    with page_client(replay.page) as client:
        whole = client.receive()
        replay.move_to_step(0)
        replay.move_to_step(last)
        assert client.receive() < 0.2 * whole


def test_another_measure_recolours_and_sends_no_points(show: RecordedShow, replay: Replay) -> None:
    titles = [measure.title for measure in show.setting.measures]
    with page_client(replay.page) as client:
        whole = client.receive()
        replay.page.choose_measure(titles[-1])
        assert 0 < client.receive() < 0.1 * whole
    replay.page.choose_measure(titles[0])


def test_runs_stand_side_by_side(show: RecordedShow) -> None:
    with Replay([show, show], PageAddress(port=0)).page as page, page_client(page) as client:
        client.receive()
        assert {"/run_0/laser", "/run_1/laser"} <= client.names()


def test_a_directory_without_a_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="no recording that can be shown"):
        read_recorded_show(tmp_path)
    assert tjscan("view", tmp_path, "--port", 0) == 2
    assert tjscan("view") == 2
    assert tjscan("view", RUN, "--port", 65_536) == 2
