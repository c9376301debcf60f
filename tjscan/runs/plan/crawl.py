"""Plan the passes of a butt joint that a crawler has measured."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError, GrooveNotFound
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.core.units import MM, MM_S
from tjscan.crawler.joint_tracking.tracking import BURIED_HEIGHT, ButtJointReading, JointTracker
from tjscan.crawler.journal import CRAWL_RECORDING
from tjscan.crawler.phases import Phase
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.laser.profile import Profile
from tjscan.planning.crawl_passes import CrawlPass, crawl_passes_of_plan
from tjscan.planning.edges import GrooveEdges, fit_edges_to_corners
from tjscan.planning.plan import plan_weld
from tjscan.planning.wps import M_MIN, read_wps
from tjscan.result.directory import JOB_FILE, job_label_of_run
from tjscan.runs.crawl.results import read_recorded_crawl
from tjscan.runs.plan.run import (
    CRAWL_PASSES_FILE,
    DividedPlan,
    WrittenPlan,
    add_file_of_key,
    write_plan,
)

STATION_LENGTH: Final = 20e-3
"""Metres along the joint whose profiles make a section."""

FEWEST_PROFILES: Final = 3
"""Profiles that make one."""

USUAL_DEPTH_RADIUS: Final = 0.1
"""Metres to either side of a place whose median depth is usual there: no tack is half as long."""

PLAN_FRAME: Final = "c"

PlacedProfiles = Sequence[tuple[float, Profile]]
"""Metres along the joint, and the profile taken there."""


def is_crawl(directory: Path) -> bool:
    """Whether a run directory is a crawl's."""
    return (directory / f"{CRAWL_RECORDING}.mcap").is_file()


def plan_crawl_run(
    directory: Path, wps_file: Path, gravity: Array, out: Path | None = None, after_pass: int = 0
) -> WrittenPlan:
    """Plan the weld of a crawl's joint and write the plan's files, with passes for a crawl job.

    Parameters
    ----------
    directory : Path
        The crawl's run directory.
    wps_file : Path
        The welding procedure specification.
    gravity : ndarray, shape (3,)
        Downwards in frame c: x along the joint, y to the right, z into the hull.
    out : Path, optional
        Where the files go; the run directory if left out.
    after_pass : int
        Passes after which the joint is looked at: on the way back from the last of them.

    Raises
    ------
    ConfigurationError
        If the WPS or the run can't be read, the joint was not seen, or nothing fits.
    RecordingError
        If the files can't be written, or the recording is damaged.
    """
    wps, job = read_wps(wps_file), read_crawl_job(directory / JOB_FILE)
    seen = _profiles_along_weld(directory, job, after_pass)
    if after_pass and not seen:
        raise ConfigurationError(
            f"the crawl saw nothing on its way back from pass {after_pass}: did it weld so many?",
            key="--after-pass",
        )
    with add_file_of_key(wps_file, directory / f"{CRAWL_RECORDING}.mcap"):
        edges, start = butt_joint_edges(seen, job.weld.length, wps.sequence.longest_step)
        plan = plan_weld(edges, wps, gravity, after_pass=after_pass)
        passes = crawl_passes_of_plan(plan)
    provenance = Provenance.for_file_written_now(job_label_of_run(directory), PLAN_FRAME, "mm")
    begin, end = 1e3 * start, 1e3 * (start + edges.length)
    text = (
        provenance.comment_lines("#")
        + f"# planned from what was seen of the weld from {begin:.0f} to {end:.0f} mm\n"
        + passes_to_toml(passes, wps.name)
    )
    texts, without = {CRAWL_PASSES_FILE: text}, f"a crawl job takes {CRAWL_PASSES_FILE}"
    divided = DividedPlan(plan)
    return write_plan(
        directory, out, wps_file, divided, provenance, texts, without_stations=without
    )


def passes_to_toml(passes: Sequence[CrawlPass], procedure: str) -> str:
    """Write passes as the tables of a crawl job.

    Parameters
    ----------
    passes : sequence of CrawlPass
        In the order of welding.
    procedure : str
        Name of the WPS.
    """
    lines = []
    for one in passes:
        bead = one.bead
        lines += [
            "",
            f"# bead {bead.number}: {bead.kind}, layer {bead.layer}.{bead.place}, wire feed "
            f"{bead.feed / M_MIN.factor:.2f} m/min; up to {1e3 * one.strays:.2f} mm off the bead's "
            f"own path, fill up to {100 * one.misfills:.1f} % off",
            "[[pass]]",
            f"speed_mm_s = {one.speed / MM_S.factor:.4f}",
            f"offset_mm = {one.offset / MM.factor:.3f}",
            f"height_mm = {one.height / MM.factor:.3f}",
            f"procedure = {json.dumps(procedure, ensure_ascii=False)}",
        ]
    return "\n".join(lines) + "\n"


def butt_joint_edges(
    seen: PlacedProfiles, length: float, longest_step: float
) -> tuple[GrooveEdges, float]:
    """Edges of a butt joint in frame c, and where along it they begin, from profiles along it.

    A section is the trapezoid with the width, depth and area of what is left to fill, the mean of
    the readings of 20 mm; its standard deviation follows from how they scatter. A root
    higher than usual is a tack weld, a deeper one a crater or the end of a pass: such readings show
    no groove to be filled alike, and only show where tacks are.

    Parameters
    ----------
    seen : sequence of (float, Profile)
        Metres along the joint, and the profile taken there, in the order in which they came.
    length : float
        Of the weld, metres.
    longest_step : float
        Sections further apart are refused, metres.

    Returns
    -------
    GrooveEdges
        Through the sections.
    float
        Metres along the joint of the first of them.

    Raises
    ------
    ConfigurationError
        If too little of the joint was seen.
    """
    readings = _read_joint(seen, length)
    places = np.array([at for at, _ in readings])
    depths = np.array([reading.depth_left for _, reading in readings])
    usual = [np.median(depths[np.abs(places - at) <= USUAL_DEPTH_RADIUS]) for at in places]
    higher = np.array(usual) - depths
    station = (places / STATION_LENGTH).astype(int)
    middles, tacked, rows = [], [], []
    for k in np.unique(station):
        is_there = station == k
        middles.append(places[is_there].mean())
        tacked.append(bool(np.mean(higher[is_there] > BURIED_HEIGHT) > 0.5))
        bare = np.flatnonzero(is_there & (np.abs(higher) <= BURIED_HEIGHT))
        if len(bare) >= FEWEST_PROFILES:
            rows.append([readings[i] for i in bare])
    if len(rows) < FEWEST_PROFILES + 1:
        raise ConfigurationError(
            f"the joint's edges and root were read at {len(rows)} stations of "
            f"{1e3 * STATION_LENGTH:.0f} mm along the weld; {FEWEST_PROFILES + 1} or more are "
            "needed",
            key="profiles",
        )
    means, spreads, area_sigmas = [], [], []
    for row in rows:
        flat = np.stack([_trapezoid_of_reading(reading) for _, reading in row])
        areas = np.array([reading.area_left for _, reading in row])
        along = np.full((4, 1), np.mean([at for at, _ in row]))
        means.append(np.hstack((along, flat.mean(axis=0) * (1, -1))))
        share = 1 / np.sqrt(len(row))
        spreads.append(share * np.linalg.norm(flat.std(axis=0, ddof=1), axis=1))
        area_sigmas.append(share * areas.std(ddof=1) / areas.mean())
    corners, sigmas = np.stack(means), np.stack(spreads)
    edges = fit_edges_to_corners(corners, sigmas, np.array(area_sigmas), longest_step)
    start, openness = float(means[0][0, 0]), np.zeros(len(middles))
    s = np.array(middles) - start
    root = replace(edges.root, s=s, openness=openness, tacked=np.array(tacked))
    return replace(edges, root=root), start


def _read_joint(seen: PlacedProfiles, length: float) -> list[tuple[float, ButtJointReading]]:
    """Readings with edges along the weld; beside it the root is another."""
    tracker, found = JointTracker(), []
    for at, profile in ((at, profile) for at, profile in seen if 0 <= at <= length):
        with suppress(GrooveNotFound):
            reading = tracker.read(profile)
            if np.isfinite(reading.edges).all() and reading.depth_left > 0:
                found.append((at, reading))
    return found


def _trapezoid_of_reading(reading: ButtJointReading) -> Array:
    """p3, p4, g and p2 across the joint from its centre, and out of the hull, shape (4, 2)."""
    across, into = reading.joint_coordinates(*reading.edges.T)
    width = float(across[1] - across[0])
    half = 0.5 * max(2 * reading.area_left / reading.depth_left - width, 0.0)
    middle, low = float(across.mean()), -float(into.mean()) - reading.depth_left
    bottom = [(middle - half, low), (middle + half, low)]
    return np.array([*bottom, (across[1], -into[1]), (across[0], -into[0])])


def _profiles_along_weld(directory: Path, job: CrawlJob, after_pass: int) -> PlacedProfiles:
    """Profiles along the weld, before the first pass or on the way back from one."""
    phases = {Phase.RETURN} if after_pass else {Phase.FORWARD_ALIGNMENT, Phase.BACKWARD_ALIGNMENT}
    return [
        (cycle.travel + job.vehicle.laser_to_torch, profile)
        for cycle, profile in read_recorded_crawl(directory).profiles
        if cycle.phase in phases and (not after_pass or cycle.number == after_pass)
    ]
