"""What the report of a run shows of its crawl."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite, nan
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.manifest import check_files_unaltered
from tjscan.crawler.joint_sections import PLACES_ACROSS, section_histories
from tjscan.crawler.journal import CRAWL_RECORDING, WARNING_EVENT, CrawlCycle
from tjscan.crawler.pass_record import root_mean_square
from tjscan.crawler.phases import Phase
from tjscan.crawler.slip_estimator import SlipStateIndex
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.recording.journal import REPLAY_EVENT
from tjscan.result.chapter import HeadlineNumber, Judgement, ReportChapter, ReportChart, verdict_on
from tjscan.result.directory import CALIBRATION_FILE, JOB_FILE
from tjscan.runs.crawl.results import RecordedCrawl, read_recorded_crawl
from tjscan.runs.weld.journal import SURFACE_EVENT

MOST_CHART_POINTS: Final = 2000
"""Of a line in a chart."""

LARGEST_TORCH_OFF: Final = 0.5e-3
"""Metres beside its path at which a torch is a finding, half of what an arc is stopped at; so is a
standard deviation as large."""

ESTIMATE_LINES: Final = (("estimate", 0.0), ("+ 2 sigma", 2.0), ("- 2 sigma", -2.0))
"""Lines of a chart of something estimated, and how many standard deviations they are off it."""

SLIP_CHARTS: Final = (
    (SlipStateIndex.YAW_EFFICIENCY, "yaw efficiency", "share of the tracks' turn", 1.0),
    (SlipStateIndex.CRAB, "crab", "crab / mrad", 1e3),
    (SlipStateIndex.DRIFT, "drift", "drift / (mrad/m)", 1e3),
    (SlipStateIndex.ROTATION_CENTRE, "centre of rotation", "ahead in travel direction / mm", 1e3),
)
"""What is estimated of slip: quantity, title, label and scale of its chart."""


def crawl_chapter(directory: Path) -> ReportChapter:
    """Make a crawl's chapter of a report; see `tjscan.result.chapter.ChapterWriter`."""
    if not (directory / f"{CRAWL_RECORDING}.mcap").is_file():
        return ReportChapter()
    check_files_unaltered(directory / JOB_FILE, directory / CALIBRATION_FILE)
    job, found = read_crawl_job(directory / JOB_FILE), read_recorded_crawl(directory)
    return ReportChapter(
        facts=tuple(_crawl_facts(job, found)),
        findings=tuple(_crawl_findings(job, found)),
        headline=tuple(_crawl_headline(job, found)),
        charts=tuple(_crawl_charts(job, found)),
        events=found.events,
    )


def _crawl_headline(job: CrawlJob, found: RecordedCrawl) -> Iterator[HeadlineNumber]:
    whole = sum(one.is_whole(job.weld.length) for one in found.passes)
    yield verdict_on(
        whole == len(job.passes), f"{whole} of {len(job.passes)} passes are welded whole"
    )
    if not found.passes:
        return
    welded = 1e3 * sum(one.length for one in found.passes)
    yield HeadlineNumber(f"{welded:.0f} mm of weld", f"in {len(found.passes)} passes")
    known = [one for one in found.passes if len(one.torch_off)]
    if known:
        worst = max(one.torch_off_max for one in known)
        judged: Judgement = "bad" if worst > LARGEST_TORCH_OFF else "good"
        text = "the torch was beside its path at most"
        yield HeadlineNumber(f"{1e3 * worst:.2f} mm", text, judged)
        sigma = max(root_mean_square(one.torch_sigma) for one in known)
        yield HeadlineNumber(f"± {1e3 * sigma:.2f} mm", "standard uncertainty of that")


def _crawl_facts(job: CrawlJob, found: RecordedCrawl) -> Iterator[tuple[str, str]]:
    yield "joint", job.weld.joint
    yield "vehicle", f"{job.vehicle.device_id} ({job.vehicle.driver}); method: {job.method}"
    yield "welder, procedure", f"{job.weld.welder}, {job.weld.procedure}"
    for one in found.passes:
        yield (
            f"pass {one.number}",
            f"{1e3 * one.length:.0f} mm in {one.seconds:.0f} s, vehicle "
            f"{1e3 * root_mean_square(one.offset):.2f} mm off (rms), torch "
            f"{1e3 * root_mean_square(one.torch_off):.2f} mm beside its path, known to "
            f"{1e3 * root_mean_square(one.torch_sigma):.2f} mm, {one.stops} stops, joint read in "
            f"{100 * one.read_share:.0f} % of profiles",
        )


def _crawl_findings(job: CrawlJob, found: RecordedCrawl) -> Iterator[str]:
    if job.simulation is not None:
        yield "Simulated: no real crawler welded this joint."
    if missing := len(job.passes) - len(found.passes):
        yield f"{missing} of {len(job.passes)} passes are not welded."
    for one in found.passes:
        if one.jog:
            yield (
                f"In pass {one.number} the torch was jogged by up to {1e3 * one.jog:+.2f} mm: "
                "if it was beside the joint before, register it (tjscan crawl register)."
            )
        if not one.is_whole(job.weld.length):
            yield (
                f"Pass {one.number} is not whole: {1e3 * one.length:.1f} of "
                f"{1e3 * job.weld.length:.0f} mm are welded."
            )
        if one.torch_off_max > LARGEST_TORCH_OFF:
            place = 1e3 * one.torch_travel[np.abs(one.torch_off).argmax()]
            yield (
                f"In pass {one.number} the torch was {1e3 * one.torch_off_max:.2f} mm beside its "
                f"path, {place:.0f} mm along the weld: calibrate on this hull, or make the run-up "
                "longer, and look at the weld there."
            )
        if (sigma := root_mean_square(one.torch_sigma)) > LARGEST_TORCH_OFF:
            yield f"Where the torch was in pass {one.number} is known to {1e3 * sigma:.2f} mm only."
    yield from _plan_findings(found)
    phases = [event.name for event in found.events if event.name in set(Phase)]
    if found.passes and phases[-1] not in (Phase.MANUAL, Phase.STOP):
        yield (
            f"Its recording ends in the phase {phases[-1]!r}, before the crawl did: the program "
            "was killed, or the file cut."
        )
    for replay in found.details_of(REPLAY_EVENT)[:1]:
        yield f"A replay, {replay}: what the {job.method} method would have estimated."
    for warning in dict.fromkeys(found.details_of(WARNING_EVENT)):
        yield f"{warning[:1].upper()}{warning[1:]}."
    for reason in found.details_of(Phase.STOP):
        yield f"It was stopped: {reason}"


def _plan_findings(found: RecordedCrawl) -> Iterator[str]:
    for number, planned in sorted(found.planned.items()):
        if planned.at_limit:
            share = f"{planned.at_limit:.0%} of pass {number}"
            yield f"{share} is at a limit of the WPS: what is missing is left to later passes."
    for detail in found.details_of(SURFACE_EVENT)[-1:]:
        yield f"Finished surface: {detail}."


def _crawl_charts(job: CrawlJob, found: RecordedCrawl) -> Iterator[ReportChart]:
    along, beside = "along the weld / mm", "to the right / mm"
    for one in found.passes:
        for line, off in ESTIMATE_LINES if len(one.torch_off) else ():
            y = 1e3 * (one.torch_off + off * one.torch_sigma)
            title = f"torch beside its path in pass {one.number}, by all that was measured"
            yield ReportChart(title, along, beside, 1e3 * one.torch_travel, y, line=line)
    for one in found.passes:
        for title, x, y in (
            ("vehicle beside the joint, as estimated", one.travel, one.offset),
            ("torch beside its path, as the simulation knows", one.true_travel, one.true_deviation),
        ):
            if len(x):
                every = max(len(x) // MOST_CHART_POINTS, 1)
                x, y = 1e3 * x[::every], 1e3 * y[::every]
                yield ReportChart(title, along, beside, x, y, line=f"pass {one.number}")
    for number in [one.number for one in found.passes]:
        burning = [c for c in found.cycles if c.arc and c.number == number]
        burning = burning[:: max(len(burning) // MOST_CHART_POINTS, 1)]
        places = 1e3 * np.array([cycle.travel for cycle in burning])
        speeds = 1e3 * np.array([cycle.state.odometry.speed for cycle in burning])
        torques = np.array([max(map(abs, cycle.state.torques), default=nan) for cycle in burning])
        line = f"pass {number}"
        yield ReportChart(
            "speed by the encoders", along, "speed / (mm/s)", places, speeds, line=line
        )
        if np.isfinite(torques).all():
            title = "torque of the harder working motor"
            yield ReportChart(title, along, "torque / (N m)", places, torques, line=line)
    title, across = "cross-section of the joint, median of each pass", "across the joint / mm"
    histories = section_histories(found.profiles, job.weld.length, job.vehicle.laser_to_torch)
    for number, height in histories.items():
        line = f"after pass {number}" if number else "before welding"
        x, y = 1e3 * PLACES_ACROSS, 1e3 * height
        yield ReportChart(title, across, "over the hull / mm", x, y, line=line)
    every = max(len(found.cycles) // MOST_CHART_POINTS, 1)
    yield from _paper_charts(job, found.cycles[::every])
    slips = [(cycle.state.time, cycle.slip) for cycle in found.cycles[::every]]
    known = [(time, slip) for time, slip in slips if slip is not None]
    times = np.array([time for time, _ in known])
    for which, title, label, scale in SLIP_CHARTS if known else ():
        values = np.array([slip.x[which] for _, slip in known])
        sigmas = np.array([slip.sigma(which) for _, slip in known])
        for line, off in ESTIMATE_LINES:
            y = scale * (values + off * sigmas)
            yield ReportChart(title, "vehicle's clock / s", label, times, y, line=line)


def _paper_charts(job: CrawlJob, cycles: Sequence[CrawlCycle]) -> Iterator[ReportChart]:
    """What the filter of the paper estimates: heading, and how far ahead its laser is."""
    cycles = [cycle for cycle in cycles if isfinite(cycle.laser_to_centre)]
    if not cycles:
        return
    times, headings, ahead, sigmas = np.array(
        [
            (c.state.time, c.torch.heading, c.laser_to_centre, c.laser_to_centre_sigma)
            for c in cycles
        ]
    ).T
    clock, true = "vehicle's clock / s", job.vehicle.laser_to_torch - job.vehicle.centre_to_torch
    yield ReportChart(
        "heading by the paper's filter", clock, "heading / mrad", times, 1e3 * headings
    )
    title, label = "laser ahead of the centre of rotation, by the paper's filter", "ahead / mm"
    lines = [(line, ahead + off * sigmas) for line, off in ESTIMATE_LINES]
    for line, values in (*lines, ("as the job states", np.full(len(times), true))):
        yield ReportChart(title, clock, label, times, 1e3 * values, line=line)
