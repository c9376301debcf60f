"""Charts that outliers do not flatten, events on the recording's clock, runs on one page."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from tjscan.core.frames import Array
from tjscan.recording.parts import recording_files
from tjscan.report.clock import EventClock
from tjscan.report.data import ReportData
from tjscan.report.overview import runs_in_folder, write_overview
from tjscan.report.picture import keep_outliers_off, new_panels
from tjscan.runs.scan.report import scan_chapter

WAVE = np.sin(np.linspace(0, 20, 200))


@pytest.fixture(name="run")
def run_directory(data: ReportData) -> Path:
    return data.directory


def shown(values: Array) -> tuple[tuple[float, float], str]:
    """Ends of a chart's y axis, and what is written in it."""
    (_,), (axes,) = new_panels(1)
    axes.plot(values)
    keep_outliers_off(axes, values)
    return axes.get_ylim(), " ".join(text.get_text() for text in axes.texts)


def test_a_few_outliers_do_not_flatten_a_chart() -> None:
    spoilt = WAVE.copy()
    spoilt[[20, 120]] = (900.0, -400.0)
    (low, high), text = shown(spoilt)
    assert -4 < low < -1 < 1 < high < 4
    assert text == "2 values beyond, to 900"


@pytest.mark.parametrize("values", [WAVE, np.zeros(50), np.full(5, np.nan), WAVE[:3] * 1e-9])
def test_without_outliers_a_chart_shows_everything(values: Array) -> None:
    (low, high), text = shown(values)
    assert text == ""
    known = values[np.isfinite(values)]
    assert (low <= known).all()
    assert (known <= high).all()


def test_events_are_counted_from_when_the_recording_began(run: Path) -> None:
    events = scan_chapter(run).events
    clock = EventClock.of_run(run, events)
    assert [name for _, name, _ in clock.rows] == [event.name for event in events]
    times = [float(time) for time, _, _ in clock.rows]
    assert times == sorted(times)
    assert 0 < times[-1] < 3600
    assert all(file.is_file() for file in recording_files(run))


def test_an_overview_names_every_run_of_a_folder(run: Path, tmp_path: Path) -> None:
    for name in ("one", "other & <b>"):
        shutil.copytree(run, tmp_path / name)
    (tmp_path / "no run").mkdir()
    assert runs_in_folder(run) == []
    runs = runs_in_folder(tmp_path)
    assert [one.name for one in runs] == ["one", "other & <b>"]
    page = write_overview(tmp_path, runs).read_text(encoding="utf-8")
    assert page.count("complete") == 2
    assert "other &amp; &lt;b&gt;" in page
    assert ("one/report.html" in page) == (run / "report.html").is_file()
