"""The smoother against the one of Rauch, Tung and Striebel, and the torch's trace in a crawl."""

import json
from pathlib import Path

import numpy as np
from crawls import SHORT

from tjscan.crawler.state_smoother import StateSmoother
from tjscan.job.crawl.job import read_crawl_job
from tjscan.runs.crawl.report import crawl_chapter
from tjscan.runs.crawl.results import read_passes, read_recorded_crawl
from tjscan.runs.crawl.run import CrawlContext, run_crawl


def test_it_equals_the_smoother_of_rauch_tung_and_striebel() -> None:
    rng, n, steps = np.random.default_rng(5), 4, 60
    x, P, Q = np.zeros(n), np.eye(n), 0.01 * np.eye(n)
    smoother = StateSmoother()
    filtered, predicted, moves = [], [], []
    for _ in range(steps):
        F = np.eye(n) + 0.1 * rng.standard_normal((n, n))
        x, P = F @ x, F @ P @ F.T + Q
        predicted.append((x, P))
        moves.append(F)
        smoother.add_move(F)
        H, variance = rng.standard_normal(n), 0.3
        S = float(H @ P @ H) + variance
        gain, off = P @ H / S, float(rng.standard_normal()) - float(H @ x)
        smoother.add_reading(H, gain, off, S)
        x, P = x + gain * off, P - np.outer(gain, H @ P)
        filtered.append((x, P))
        if len(filtered) % 7 == 1:
            smoother.keep(x, P, np.eye(n)[2])
    smoothed = [filtered[-1]]
    for k in reversed(range(steps - 1)):
        (xf, Pf), (xp, Pp), (xs, Ps) = filtered[k], predicted[k + 1], smoothed[-1]
        C = Pf @ moves[k + 1].T @ np.linalg.inv(Pp)
        smoothed.append((xf + C @ (xs - xp), Pf + C @ (Ps - Pp) @ C.T))
    smoothed.reverse()
    values, sigmas = smoother.smooth()
    np.testing.assert_allclose(values, [x[2] for x, _ in smoothed[::7]], atol=1e-9)
    np.testing.assert_allclose(sigmas, [P[2, 2] ** 0.5 for _, P in smoothed[::7]], rtol=1e-7)
    assert not len(smoother.smooth()[0])  # forgotten


def test_log_table_and_report_state_where_the_torch_was(tmp_path: Path) -> None:
    file, out = tmp_path / "job.toml", tmp_path / "run"
    file.write_text(SHORT)
    job = read_crawl_job(file)
    run_crawl(CrawlContext(job, file), out)
    found = read_recorded_crawl(out)
    for one in found.passes:
        assert len(one.torch_off) > 25
        assert one.torch_travel[0] < 1e-3
        assert one.torch_travel[-1] > job.weld.length - 2e-3
        true = np.interp(one.torch_travel, one.true_travel, one.true_deviation)
        assert np.all(np.abs(one.torch_off - true) < 4 * one.torch_sigma + 0.2e-3)
    log = json.loads((out / "weld-log.json").read_text())
    for row, logged, one in zip(read_passes(out), log["passes"], found.passes, strict=True):
        assert float(row["torch_off_max_mm"]) == logged["torch_off_max_mm"]
        assert logged["torch_off_max_mm"] == round(1e3 * one.torch_off_max, 3)
    assert len(found.details_of("torch")) == 2
    chapter = crawl_chapter(out)
    traced = [chart for chart in chapter.charts if "by all that was measured" in chart.title]
    assert [chart.line for chart in traced] == 2 * ["estimate", "+ 2 sigma", "- 2 sigma"]
    off = [one.number for one in found.passes if one.torch_off_max > 0.5e-3]
    assert sum(text.startswith("In pass") for text in chapter.findings) == len(off)
    # Its short ways do not show the crab, and its guard lets it weld nevertheless.
    assert sum(text.startswith("Where the torch was") for text in chapter.findings) == 2
