"""Plan the weld of a scan or of a crawl, and write the plan with a program for each station."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError, GrooveNotFound, PoseUnreachable, TubesNotFound
from tjscan.core.files import write_files_atomically
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.core.units import M_PER_MIN, MM, MM2, MM_S
from tjscan.crawler.joint_tracking.tracking import BURIED_HEIGHT, ButtJointReading, JointTracker
from tjscan.crawler.journal import CRAWL_RECORDING
from tjscan.crawler.phases import Phase
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.root import WELD_IN_GROOVE
from tjscan.job.crawl.job import CrawlJob, read_crawl_job
from tjscan.joint.tubes.find import find_tubes_in_cloud
from tjscan.joint.tubes.fit import dihedral_angles, dihedral_sigmas
from tjscan.laser.profile import Profile
from tjscan.planning.crawl_passes import CrawlPass, crawl_passes_of_plan
from tjscan.planning.details import DetailStretch, find_stretches_off_details
from tjscan.planning.document import PlanDocument, StationEntry, beads_to_csv, plan_document
from tjscan.planning.edges import GrooveEdges, fit_edges_to_corners, fit_groove_edges
from tjscan.planning.leg import bound_groove_by_leg
from tjscan.planning.plan import WeldPlan, plan_weld
from tjscan.planning.stops import UNREACHED_STATION, StationStretch, crowns_and_saddles
from tjscan.planning.urscript import StationPath, path_to_urscript
from tjscan.planning.weldx_file import weldx_is_installed, write_plan_as_weldx
from tjscan.planning.wps import WeldingProcedure, read_wps
from tjscan.result.directory import CLOUD_FILE, JOB_FILE, SECTIONS_FILE, job_label_of_run
from tjscan.result.export import WELDX_ROOT_FRAME_NAMES
from tjscan.result.shapes import read_finished_sections, read_run_shape
from tjscan.runs.crawl.results import read_recorded_crawl
from tjscan.runs.plan.reach import (
    SOLE_STATION_NAME,
    WeldingStation,
    find_station_reach,
    groove_surface,
    rounded_mm,
    welding_stations,
)

PLAN_FILE: Final = "plan.json"
BEADS_FILE: Final = "beads.csv"
PLAN_PICTURE: Final = "plan.png"
WELDX_FILE: Final = "plan.weldx"
CRAWL_PASSES_FILE: Final = "plan-passes.toml"
"""Tables that a crawl job takes."""

STALE_PLAN_FILES: Final = (
    "plan.urscript",
    "plan-*.urscript",
    CRAWL_PASSES_FILE,
    WELDX_FILE,
    "plan.html",
)
"""Not every plan has them: files of an earlier one do not stay beside a new one."""


@contextmanager
def add_file_to_plan_errors(wps_file: Path, sections: Path) -> Iterator[None]:
    """Add to errors of the block the file that holds their key: the WPS, or the sections.

    An option of the command line is in no file.
    """
    try:
        yield
    except ConfigurationError as error:
        key = error.key or ""
        of_wps = key.split(".")[0] in WeldingProcedure.model_fields
        file = error.file or (wps_file if of_wps else sections)
        named = None if key.startswith("--") else file
        raise ConfigurationError(error.message, file=named, key=error.key) from None


def _check_passes_are_stated(sections: Sequence[MeasuredSection], after_pass: int) -> None:
    """Refuse a groove with weld in it if no passes are stated: its root would be welded again."""
    welded = [k for k, one in enumerate(sections, 1) if WELD_IN_GROOVE in one.conditions]
    if welded and not after_pass:
        raise ConfigurationError(
            f"{len(welded)} of {len(sections)} sections, the first number {welded[0]}, have weld "
            "in the groove: state how many passes are welded",
            key="--after-pass",
        )


def check_wps_details(
    directory: Path, sections: Sequence[MeasuredSection], edges: GrooveEdges, wps: WeldingProcedure
) -> tuple[DetailStretch, ...]:
    """Compare a run's groove with the WPS's table, by the tubes fitted to its cloud.

    Parameters
    ----------
    directory : Path
        The run directory.
    sections : sequence of MeasuredSection
        In their order along the groove.
    edges : GrooveEdges
        Smoothed through them.
    wps : WeldingProcedure
        Without a table, nothing is compared and no tube sought.

    Raises
    ------
    ConfigurationError
        If its cloud shows no tubes.
    """
    if not wps.detail:
        return ()
    shape = read_run_shape(directory)
    try:
        tubes = find_tubes_in_cloud(np.empty((0, 3)) if shape.points is None else shape.points)
    except TubesNotFound as error:
        raise ConfigurationError(
            f"the local dihedral angle is not known, since leg and brace were not found: {error}. "
            "Leave out [[detail]] to plan without",
            file=directory / CLOUD_FILE,
        ) from None
    origins = np.array([section.T_r_g[:3, 3] for section in sections])
    angles = dihedral_angles(tubes.brace, tubes.leg, origins)
    return find_stretches_off_details(edges, angles, dihedral_sigmas(tubes, origins), wps.detail)


Replan = Callable[[tuple[StationStretch, ...]], WeldPlan]


@dataclass(frozen=True, slots=True, eq=False)
class DividedPlan:
    """A plan divided among stations, and the path of the torch at each.

    Parameters
    ----------
    plan : WeldPlan
        Its beads, in parts.
    stations : tuple of StationEntry
        As in ``plan.json``.
    paths : dict of str to StationPath
        Of each station that has a program, by the program's file.
    without_stations : str
        Why there are no stations.
    """

    plan: WeldPlan
    stations: tuple[StationEntry, ...] = ()
    paths: dict[str, StationPath] = field(default_factory=dict)
    without_stations: str = ""


def divide_plan(
    arms: Sequence[WeldingStation],
    plan: WeldPlan,
    sections: Sequence[MeasuredSection],
    replan: Replan,
) -> DividedPlan:
    """Part a plan among the stations from which a run was scanned.

    Parameters
    ----------
    arms : sequence of WeldingStation
        In the order in which they weld.
    plan : WeldPlan
        Its beads whole.
    sections : sequence of MeasuredSection
        Along the groove.
    replan : callable
        Makes the same plan, divided among stretches.

    Raises
    ------
    ConfigurationError
        If the torch reaches nothing, or an arm has no closed form of its inverse kinematics.
    """
    groove = groove_surface(plan.edges, np.array([section.points for section in sections]))
    reaches = []
    for arm in arms:
        with add_file_to_errors(arm.job_file):
            reaches.append(find_station_reach(arm, plan, groove))
    stretches = tuple(stretch for reach in reaches if (stretch := reach.stretch) is not None)
    if not stretches:
        reasons = "; ".join(f"{one.station.name}: {one.usual_hindrance}" for one in reaches)
        raise ConfigurationError(
            f"no station reaches any of the groove with this torch: {reasons}", key="torch"
        )
    divided, paths, entries = replan(stretches), dict[str, StationPath](), []
    welding = {bead.station for bead in divided.beads}
    names = tuple(arm.name for arm in arms if arm.name in welding)
    for reach in reaches:
        name, problem, file = reach.station.name, "", ""
        if name in welding:
            file = "plan.urscript" if name == SOLE_STATION_NAME else f"plan-{name}.urscript"
            try:
                path = reach.lead_torch(divided)
                k = names.index(name)
                paths[file] = replace(path, before=names[:k], after=names[k + 1 :])
            except PoseUnreachable as error:
                file, problem = "", error.reason
        stretch, entry = reach.stretch, {"program": file, "without_program": problem}
        reached = None if stretch is None else (rounded_mm(stretch.begin), rounded_mm(stretch.end))
        entries.append(
            StationEntry(name=name, reached_mm=reached, unreached=reach.unreached, **entry)
        )
    return DividedPlan(divided, tuple(entries), paths)


@dataclass(frozen=True, slots=True)
class ArcSwitch:
    """How a program switches the arc.

    Parameters
    ----------
    output : int
        Number of the controller's standard digital output.
    on : bool
        Whether it is switched on on the beads; else it stays off throughout.
    """

    output: int
    on: bool


@dataclass(frozen=True, slots=True, eq=False)
class WrittenPlan:
    """A plan that was written.

    Parameters
    ----------
    plan : WeldPlan
        The plan.
    document : PlanDocument
        As in ``plan.json``.
    directory : Path
        Where its files are.
    files : tuple of str
        Their names.
    paths : dict of str to StationPath
        How each station leads the torch, by its program's file.
    """

    plan: WeldPlan
    document: PlanDocument
    directory: Path
    files: tuple[str, ...]
    paths: dict[str, StationPath] = field(default_factory=dict)

    @property
    def unreached_spans(self) -> tuple[tuple[float, float], ...]:
        """Lengths that no station reaches, if that was looked for; metres."""
        if not self.document.stations:
            return ()
        unreached = (bead for bead in self.plan.beads if bead.station == UNREACHED_STATION)
        spans = (bead.s for bead in unreached if bead.layer == 1)
        return tuple((float(s.min()), float(s.max())) for s in spans)


def write_plan(
    directory: Path,
    out: Path | None,
    wps_file: Path,
    divided: DividedPlan,
    provenance: Provenance,
    texts: Mapping[str, str],
    details: Sequence[DetailStretch] = (),
) -> WrittenPlan:
    """Write document, picture and table of a plan, and the weldx file if weldx is installed.

    Parameters
    ----------
    directory : Path
        Of the run.
    out : Path or None
        Where to; the run directory if it is None.
    wps_file : Path
        The welding procedure specification.
    divided : DividedPlan
        The plan.
    provenance : Provenance
        Of all files.
    texts : mapping
        Name and text of each further file.
    details : sequence of DetailStretch, optional
        How the groove compares with the WPS's table.
    """
    from tjscan.planning.picture import draw_plan
    from tjscan.result.picture import write_png

    plan, folder, name = divided.plan, out or directory, directory.resolve().name
    label = f"{plan.wps.name}, SHA-256 {sha256(wps_file.read_bytes()).hexdigest()[:16]}"
    places = divided.stations, divided.without_stations
    document = plan_document(plan, provenance, name, label, details, *places)
    with write_files_atomically(folder, last=PLAN_FILE, instead_of=STALE_PLAN_FILES) as draft:
        for file, text in texts.items():
            (draft / file).write_text(text, encoding="utf-8")
        sides = "left to right edge" if provenance.frame == CRAWL_PLAN_FRAME else "bevel to leg"
        write_png(draft / PLAN_PICTURE, draw_plan(plan, f"from {sides}"), provenance)
        provenance.write_table(draft / BEADS_FILE, beads_to_csv(plan))
        if weldx_is_installed():
            root = WELDX_ROOT_FRAME_NAMES.get(provenance.frame, provenance.frame)
            write_plan_as_weldx(draft / WELDX_FILE, plan, document, root)
        (draft / PLAN_FILE).write_text(document.model_dump_json(indent=1) + "\n", encoding="utf-8")
        files = tuple(sorted(one.name for one in draft.iterdir()))
    return WrittenPlan(plan, document, folder, files, divided.paths)


def plan_run(
    directory: Path,
    wps_file: Path,
    gravity: Array,
    switch: ArcSwitch,
    out: Path | None = None,
    after_pass: int = 0,
    *,
    reach: bool = True,
) -> WrittenPlan:
    """Plan the weld of a run's groove and write the plan's files.

    Parameters
    ----------
    directory : Path
        The run directory, of one scan or stitched.
    wps_file : Path
        The welding procedure specification.
    gravity : ndarray, shape (3,)
        Downwards in the frame of the run's sections.
    switch : ArcSwitch
        How the arc is switched in the program.
    out : Path, optional
        Where the files go; the run directory if left out.
    after_pass : int
        Passes that were welded before the groove was measured.
    reach : bool
        Whether to find out what the arm reaches; without that there is no program.

    Raises
    ------
    ConfigurationError
        If the WPS or the run can't be read, or nothing that the WPS allows fits.
    RecordingError
        If the files can't be written.
    """
    wps = read_wps(wps_file)
    summary, sections = read_finished_sections(directory)
    with add_file_to_plan_errors(wps_file, directory / SECTIONS_FILE):
        _check_passes_are_stated(sections, after_pass)
        # By what the areas of all sections err alike, m²; 0 if that is not known.
        parts = () if summary.uncertainty is None else summary.uncertainty.components
        areas = [part.area_mm2 for part in parts if part.shared]
        shared = MM2.factor * float(np.linalg.norm(areas))
        edges = fit_groove_edges(sections, wps.sequence.longest_step, shared)
        edges = bound_groove_by_leg(edges)
        # In frame j, z is the brace's axis; in an arm's base frame nothing is known of the tubes.
        marks = crowns_and_saddles(edges, np.eye(4)) if summary.frame == "j" else np.empty(0)
        plan = plan_weld(edges, wps, gravity, marks, after_pass=after_pass)
        details = check_wps_details(directory, sections, edges, wps)
        divided = DividedPlan(plan, without_stations="reach was not asked for")
        if reach:
            try:
                arms = welding_stations(directory, summary.frame)
            except ConfigurationError as error:
                divided = DividedPlan(plan, without_stations=str(error))
            else:
                replan = partial(plan_weld, edges, wps, gravity, marks, after_pass=after_pass)
                divided = divide_plan(arms, plan, sections, replan)
    provenance = Provenance.for_file_written_now(job_label_of_run(directory), summary.frame, "mm")
    head = "".join(provenance.comment_lines("#").splitlines(keepends=True)[:3])  # no frame, units
    programs = {
        name: head + path_to_urscript(path, wps, switch.output, arc=switch.on)
        for name, path in divided.paths.items()
    }
    return write_plan(directory, out, wps_file, divided, provenance, programs, details)


AVERAGED_LENGTH: Final = 20e-3
"""Metres along the joint whose profiles make a section."""

FEWEST_PROFILES: Final = 3
"""Profiles that make one."""

DEPTH_MEDIAN_HALF_WINDOW: Final = 0.1
"""Metres to either side of a place whose median depth is usual there: no tack is half as long."""

CRAWL_PLAN_FRAME: Final = "c"

PlacedProfiles = Sequence[tuple[float, Profile]]
"""Metres along the joint, and the profile taken there."""


def is_crawl_run(directory: Path) -> bool:
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
    with add_file_to_plan_errors(wps_file, directory / f"{CRAWL_RECORDING}.mcap"):
        edges = butt_joint_edges(seen, job.weld.length, wps.sequence.longest_step)
        plan = plan_weld(edges, wps, gravity, after_pass=after_pass)
        passes = crawl_passes_of_plan(plan)
    label = job_label_of_run(directory)
    provenance = Provenance.for_file_written_now(label, CRAWL_PLAN_FRAME, "mm")
    begin, end = 1e3 * edges.sections[1], 1e3 * edges.sections[-2]
    head = f"# seen from {begin:.0f} to {end:.0f} mm of the weld, and taken to go on as there\n"
    text = provenance.comment_lines("#") + head + passes_to_toml(passes, wps)
    divided = DividedPlan(plan, without_stations=f"a crawl job takes {CRAWL_PASSES_FILE}")
    return write_plan(directory, out, wps_file, divided, provenance, {CRAWL_PASSES_FILE: text})


def passes_to_toml(passes: Sequence[CrawlPass], wps: WeldingProcedure) -> str:
    """Write passes as the tables of a crawl job.

    Parameters
    ----------
    passes : sequence of CrawlPass
        In the order of welding.
    wps : WeldingProcedure
        That they are of.
    """
    lines = []
    for one in passes:
        bead, table = one.bead, one.table
        lines += [
            "",
            f"# bead {bead.number}: {bead.kind}, layer {bead.layer}.{bead.place}; between rows up "
            f"to {1e3 * one.strays:.2f} mm off the bead's own path, fill up to "
            f"{100 * one.misfills:.1f} % off",
            "[[pass]]",
            f"procedure = {json.dumps(wps.name, ensure_ascii=False)}",
        ]
        if wps.weave is not None:
            swing = wps.weave
            lines += [f"weave_period_s = {swing.period:g}", f"dwell_s = {swing.dwell:g}"]
        columns = {
            "s_mm": table.s / MM.factor,
            "speed_mm_s": table.speed / MM_S.factor,
            "offset_mm": table.offset / MM.factor,
            "height_mm": table.height / MM.factor,
            "weave_mm": table.weave / MM.factor,
            "feed_m_min": table.feed / M_PER_MIN.factor,
        }
        rows = [
            ", ".join(f"{key} = {x:.4f}" for key, x in zip(columns, row, strict=True))
            for row in zip(*columns.values(), strict=True)
        ]
        lines += ["segments = [", *(f"  {{ {row} }}," for row in rows), "]"]
    return "\n".join(lines) + "\n"


def butt_joint_edges(seen: PlacedProfiles, length: float, longest_step: float) -> GrooveEdges:
    """Edges of a butt joint in frame c, all along the weld, from profiles along it.

    A section is the trapezoid with the width, depth and area of what is left to fill, the mean of
    the readings of 20 mm; its standard deviation follows from how they scatter. A root
    higher than usual is a tack weld, a deeper one a crater or the end of a pass: such readings show
    no groove to be filled alike, and only show where tacks are. Before the first section and behind
    the last one the joint is taken to go on as there; its standard deviation grows with the square
    root of the distance, by as much as sections differ.

    Parameters
    ----------
    seen : sequence of (float, Profile)
        Metres along the joint, and the profile taken there, in the order in which they came.
    length : float
        Of the weld, metres.
    longest_step : float
        Sections further apart are refused, and ends of the weld further from one; metres.

    Raises
    ------
    ConfigurationError
        If too little of the joint was seen.
    """
    readings = _read_along_weld(seen, length)
    places = np.array([at for at, _ in readings])
    depths = np.array([reading.depth_left for _, reading in readings])
    usual = [np.median(depths[np.abs(places - at) <= DEPTH_MEDIAN_HALF_WINDOW]) for at in places]
    higher = np.array(usual) - depths
    station = (places / AVERAGED_LENGTH).astype(int)
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
            f"{1e3 * AVERAGED_LENGTH:.0f} mm along the weld; {FEWEST_PROFILES + 1} or more are "
            "needed",
            key="profiles",
        )
    means, spreads, area_sigmas, of_reading = [], [], [], []
    for row in rows:
        flat = np.stack([_groove_corners_of_reading(reading) for _, reading in row])
        areas = np.array([reading.area_left for _, reading in row])
        along = np.full((4, 1), np.mean([at for at, _ in row]))
        means.append(np.hstack((along, flat.mean(axis=0) * (1, -1))))
        share = 1 / np.sqrt(len(row))
        spreads.append(share * np.linalg.norm(flat.std(axis=0, ddof=1), axis=1))
        area_sigmas.append(share * areas.std(ddof=1) / areas.mean())
        of_reading.append(areas.std(ddof=1))
    corners, sigmas, area_sigma = _sections_to_ends(
        np.stack(means), np.stack(spreads), np.array(area_sigmas), length
    )
    edges = fit_edges_to_corners(corners, sigmas, area_sigma, longest_step)
    root = replace(
        edges.root, s=np.array(middles), openness=np.zeros(len(middles)), tacked=np.array(tacked)
    )
    # No mean is surer than a reading: what readings of one laser have in common is not known.
    return replace(edges, root=root, shared_area_sigma=float(np.mean(of_reading)))


def _sections_to_ends(
    corners: Array, sigmas: Array, area_sigma: Array, length: float
) -> tuple[Array, Array, Array]:
    """Sections with one more at either end of the weld: the nearest one, less certain."""
    step = corners[1:, :, 1:] - corners[:-1, :, 1:]
    apart = np.diff(corners[:, 0, 0])[:, None]
    drift = np.sqrt(np.mean(np.sum(step**2, axis=2) / apart, axis=0))  # a root of a metre
    depth, width = corners[:, 2, 2] - corners[:, 1, 2], np.ptp(corners[:, 2:, 1], axis=1)
    rows = []
    for k, end in ((0, 0.0), (-1, length)):
        way = abs(corners[k, 0, 0] - end)
        at_end = corners[k].copy()
        at_end[:, 0] = end
        grown = drift * np.sqrt(way)
        of_area = np.hypot(grown[2] / depth[k], grown[1] / width[k])
        rows.append((at_end, np.hypot(sigmas[k], grown), np.hypot(area_sigma[k], of_area)))
    first, last = rows
    whole = (
        np.concatenate(([a], b, [c]))
        for a, b, c in zip(first, (corners, sigmas, area_sigma), last, strict=True)
    )
    return next(whole), next(whole), next(whole)


def _read_along_weld(seen: PlacedProfiles, length: float) -> list[tuple[float, ButtJointReading]]:
    """Readings with edges along the weld; beside it the root is another."""
    tracker, found = JointTracker(), []
    for at, profile in ((at, profile) for at, profile in seen if 0 <= at <= length):
        with suppress(GrooveNotFound):
            reading = tracker.read(profile)
            if np.isfinite(reading.edges).all() and reading.depth_left > 0:
                found.append((at, reading))
    return found


def _groove_corners_of_reading(reading: ButtJointReading) -> Array:
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
