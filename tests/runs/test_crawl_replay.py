"""Laws of a replay: the same estimator believes the same, and another moves nothing."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command import tjscan

from tjscan.core.errors import ConfigurationError
from tjscan.crawler.journal import CrawlCycle
from tjscan.crawler.pass_record import root_mean_square
from tjscan.job.crawl.job import read_crawl_job
from tjscan.runs.crawl.results import RecordedCrawl, read_passes, read_recorded_crawl
from tjscan.runs.crawl.run import CrawlContext, replay_crawl, resume_crawl, run_crawl

JOB = """
[alignment]
speed_mm_s = 60
return_speed_mm_s = 60
length_mm = 50
longest_mm = 60
offset_mm = 20
offset_sigma_mm = 20
in_view_s = 0.1
[guards]
torch_sigma_mm = 20
[weld]
length_m = 0.02
run_up_mm = 10
[[pass]]
speed_mm_s = 30
weave_mm = 2
weave_period_s = 1
[simulation.vehicle]
start_mm = [-10.0, 0.5]
"""


NARROW = """
[simulation.laser]
half_angle_deg = 6.5
[simulation.joint]
width_mm = 20
depth_mm = 10
"""
"""A line of 34 mm, which shows 7 mm of hull on both sides of the joint."""


class InterruptedInWeld:
    """A journal that interrupts the crawl in the middle of the weld."""

    def record(self, message: object) -> None:
        if isinstance(message, CrawlCycle) and message.arc and message.travel > 0.010:
            raise KeyboardInterrupt


class InterruptedWhileItWaits(InterruptedInWeld):
    """A journal that interrupts a crawl before it goes on."""

    def record(self, message: object) -> None:
        if isinstance(message, CrawlCycle):
            raise KeyboardInterrupt


def interrupted_crawl(folder: Path, text: str) -> CrawlContext:
    """Crawl until the middle of the weld, and return what goes on with it."""
    file, out = folder / "job.toml", folder / "run"
    file.write_text(text)
    with pytest.raises(KeyboardInterrupt):
        run_crawl(CrawlContext(read_crawl_job(file), file, InterruptedInWeld()), out)
    return CrawlContext(read_crawl_job(out / "job.toml"), out / "job.toml")


def crawl_in_two_parts(folder: Path, method: str, place: float | None = None) -> Path:
    """Crawl, be interrupted, and go on: what was known then begins the second part."""
    light = "[simulation]\narc_points_percent = 0\n" if method == "paper" else ""
    context = interrupted_crawl(folder, f'method = "{method}"\n{JOB}{light}')
    resume_crawl(context, overlap=0.005, place=place)
    return context.job_file.parent


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return crawl_in_two_parts(tmp_path_factory.mktemp("slip-aware"), "slip-aware")


def estimates(found: RecordedCrawl) -> np.ndarray:
    torches = [cycle.torch for cycle in found.cycles]
    return np.array([(torch.offset, torch.sigma, torch.heading) for torch in torches])


def slips(found: RecordedCrawl) -> np.ndarray:
    known = [cycle.slip for cycle in found.cycles if cycle.slip is not None]
    return np.array([np.concatenate((slip.x, slip.P.ravel())) for slip in known])


def test_the_same_estimator_believes_the_same_again(run: Path, tmp_path: Path) -> None:
    replay_crawl(run, {}, tmp_path / "again")
    before, after = read_recorded_crawl(run), read_recorded_crawl(tmp_path / "again")
    assert len((*run.glob("crawl*.mcap"),)) == 2
    np.testing.assert_allclose(estimates(after), estimates(before), rtol=0, atol=1e-9)
    assert len(slips(before)) > 100
    np.testing.assert_allclose(slips(after), slips(before), rtol=0, atol=1e-9)
    assert read_passes(tmp_path / "again") == read_passes(run)


def test_a_vehicle_that_was_set_down_again_is_estimated_there(tmp_path: Path) -> None:
    run = crawl_in_two_parts(tmp_path, "slip-aware", place=0.011)
    replay_crawl(run, {}, tmp_path / "again")
    before, after = read_recorded_crawl(run), read_recorded_crawl(tmp_path / "again")
    np.testing.assert_allclose(slips(after), slips(before), rtol=0, atol=1e-9)
    np.testing.assert_allclose(estimates(after), estimates(before), rtol=0, atol=1e-9)


def test_one_that_was_set_down_and_interrupted_while_it_waits_is_believed_there_again(
    tmp_path: Path,
) -> None:
    context = interrupted_crawl(tmp_path, JOB)
    run = context.job_file.parent
    with pytest.raises(KeyboardInterrupt):
        resume_crawl(replace(context, journal=InterruptedWhileItWaits()), place=0.011)
    assert [event.name for event in read_recorded_crawl(run).events][-2:] == ["set-down", "stop"]
    replay_crawl(run, {}, tmp_path / "again")
    before, after = read_recorded_crawl(run), read_recorded_crawl(tmp_path / "again")
    np.testing.assert_allclose(estimates(after), estimates(before), rtol=0, atol=1e-9)


def test_where_nobody_can_look_whether_it_was_moved_its_operator_must_say(tmp_path: Path) -> None:
    context = interrupted_crawl(tmp_path, JOB + NARROW)
    run = context.job_file.parent
    before = sorted(run.iterdir())
    with pytest.raises(ConfigurationError, match="state with --place where the torch is"):
        resume_crawl(context)
    assert sorted(run.iterdir()) == before
    resume_crawl(context, overlap=0.005, place=0.010)
    found = read_recorded_crawl(run)
    assert [event.name for event in found.events].count("set-down") == 1
    replay_crawl(run, {}, tmp_path / "again")
    after = read_recorded_crawl(tmp_path / "again")
    np.testing.assert_allclose(estimates(after), estimates(found), rtol=0, atol=1e-9)


def test_a_damaged_part_is_refused_before_anything_is_made(run: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged"
    shutil.copytree(run, damaged)
    data = bytearray((damaged / "crawl-2.mcap").read_bytes())
    data[len(data) // 2] ^= 1
    (damaged / "crawl-2.mcap").write_bytes(data)
    assert tjscan("crawl", "replay", damaged, "--out", tmp_path / "again") == 1
    assert not (tmp_path / "again").exists()


def test_the_papers_estimator_believes_the_same_again(tmp_path: Path) -> None:
    run = crawl_in_two_parts(tmp_path, "paper")
    replay_crawl(run, {}, tmp_path / "again")
    before, after = read_recorded_crawl(run), read_recorded_crawl(tmp_path / "again")
    np.testing.assert_allclose(estimates(after), estimates(before), rtol=0, atol=1e-9)


def test_another_estimator_believes_otherwise_and_moves_nothing(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "paper"
    assert tjscan("crawl", "replay", run, "--method", "paper", "--out", out) == 0
    assert tjscan("crawl", "compare", run, out) == 0
    before, after = read_recorded_crawl(run), read_recorded_crawl(out)
    assert len(after.profiles) == len(before.profiles)
    for one, other in zip(before.passes, after.passes, strict=True):
        assert one.arcs == other.arcs
        # What each has wrong is held against the one truth.
        np.testing.assert_array_equal(one.true_deviation, other.true_deviation)
        assert root_mean_square(one.offset_error) != root_mean_square(other.offset_error)
        assert abs(one.offset - other.offset).max() > 1e-4
    assert {row["true_deviation_rms_mm"] for row in read_passes(out)} == {
        row["true_deviation_rms_mm"] for row in read_passes(run)
    }
    assert read_crawl_job(out / "job.toml").method == "paper"
    assert "nothing moved: what the paper method" in (out / "report.html").read_text()


def test_a_replay_is_no_weld(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    replay_crawl(run, {}, out)
    assert not (out / "weld-log.json").exists()
    assert tjscan("crawl", "run", out, "--resume") == 2


@pytest.mark.parametrize(
    "words",
    [("--weld.length-m", "1"), ("--method", "guess"), ("--slip.crab-mm", "1")],
)
def test_what_is_done_can_not_be_changed(run: Path, tmp_path: Path, words: tuple[str, ...]) -> None:
    assert tjscan("crawl", "replay", run, *words, "--out", tmp_path / "x") == 2
    assert not (tmp_path / "x").exists()


def test_a_replay_overwrites_nothing(run: Path, tmp_path: Path) -> None:
    assert tjscan("crawl", "replay", run, "--out", run) == 2
    assert tjscan("crawl", "replay", run, "--out", run / "again") == 2
    assert tjscan("crawl", "replay", tmp_path / "none", "--out", tmp_path / "x") == 2
    assert not (tmp_path / "x").exists()
