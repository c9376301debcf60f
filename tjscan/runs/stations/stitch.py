"""Stitch the scans of several stations, from their run directories."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from tjscan.core.config import add_file_to_errors, validate_table
from tjscan.core.errors import ConfigurationError, StitchingRefused
from tjscan.core.files import write_files_atomically
from tjscan.core.frames import (
    Array,
    JointOrBaseFrame,
    inverse_pose,
    pose_to_euler_zyx,
    rotation_angle_between,
    transform_points,
)
from tjscan.core.manifest import check_files_unaltered
from tjscan.core.provenance import Provenance
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.joint.definition import JointDefinition
from tjscan.recording.parts import recording_files
from tjscan.recording.reader import read_job_snapshot
from tjscan.result import directory as run_files
from tjscan.result import summary as results
from tjscan.result.picture import draw_groove_overview, write_png
from tjscan.result.section import absent_corners
from tjscan.result.table import GrooveCloud
from tjscan.result.wireframe import joint_wireframe
from tjscan.runs.run import RUN_INPUT_FILES, WhenFinished, do_nothing
from tjscan.runs.scan.results import cloud_of_sections, corner_errors, write_run_results
from tjscan.runs.scan.run import ScanContext, groove_reader_of_job
from tjscan.runs.scan.uncertainty import causes_of_job
from tjscan.scanning.continuous.smoothing import finished_sections
from tjscan.scanning.recording import read_recorded_scan
from tjscan.stitching import registration
from tjscan.stitching.picture import draw_stitching
from tjscan.stitching.stations import (
    DEFAULT_STITCH_SETTINGS,
    Station,
    StitchSettings,
    station_from_recording,
)
from tjscan.stitching.stitch import PlacedStation, StitchedGroove
from tjscan.uncertainty.budget import summarise_budget


def build_stitching_report(
    stitched: StitchedGroove, sources: Mapping[str, str]
) -> results.StitchingReport:
    """Convert a stitched groove to the report of its stations and overlaps, in mm and degrees.

    Parameters
    ----------
    stitched : StitchedGroove
        In metres and radians.
    sources : mapping of str to str
        Each station's run directory, relative to the result's, by the station's name.
    """
    units = np.array((2e3, 2e3, 180 / np.pi, 1e3))
    names = ("brace_diameter_mm", "leg_diameter_mm", "angle_deg", "offset_mm")
    shape = dict(zip(names, (units * stitched.shape.as_array).tolist(), strict=True))
    spread = zip(names, (units * stitched.shape_sigma).tolist(), strict=True)
    first = stitched.stations[0]
    middle = np.mean([section.T_r_g[:3, 3] for section in stitched.sections], axis=0)
    stations = tuple(one.fit.station.name for one in stitched.stations)
    return results.StitchingReport(
        frame="j",
        covered_deg=float(np.degrees(stitched.covered)),
        **shape,
        **{f"sigma_{name}": value for name, value in spread},
        out_of_round_mm=1e3 * stitched.out_of_round,
        loop_gap_before_mm=_mm_if_known(stitched.gap_before),
        loop_gap_after_mm=_mm_if_known(stitched.gap_after),
        stations=tuple(
            _station_report(one, first, middle, sources.get(one.fit.station.name, ""))
            for one in stitched.stations
        ),
        overlaps=tuple(
            _overlap_report(edge, stations, gap)
            for edge, gap in zip(stitched.registrations, stitched.gaps, strict=True)
        ),
    )


def _mm_if_known(length: float | None) -> float | None:
    return None if length is None else 1e3 * length


def _as_triple(values: Array) -> results.Triple:
    a, b, c = values.tolist()
    return a, b, c


def _station_report(
    one: PlacedStation, first: PlacedStation, middle: Array, source: str
) -> results.StationPlacement:
    position, angles = pose_to_euler_zyx(one.T_j_b)
    spread = np.sqrt(np.diag(one.covariance))
    station, tubes = one.fit.station, one.fit.tubes
    meant = inverse_pose(first.fit.station.T_w_b) @ station.T_w_b
    found = inverse_pose(first.T_j_b) @ one.T_j_b
    at_groove = registration.point_covariance_from_pose(one.covariance, middle)
    return results.StationPlacement(
        name=station.name,
        source=source,
        position_mm=_as_triple(1e3 * position),
        euler_zyx_deg=_as_triple(np.degrees(angles)),
        sigma_position_mm=_as_triple(1e3 * spread[:3]),
        sigma_rotation_deg=_as_triple(np.degrees(spread[3:])),
        sigma_groove_mm=float(1e3 * np.sqrt(np.trace(at_groove) / 3)),
        azimuth_deg=(float(np.degrees(one.arc.start)), float(np.degrees(one.arc.end))),
        sections=len(station.sections),
        views=len(station.all_sections),
        nominal_off_mm=float(1e3 * np.linalg.norm(found[:3, 3] - meant[:3, 3])),
        nominal_off_deg=float(np.degrees(rotation_angle_between(found, meant))),
        walls_rms_mm=1e3 * tubes.rms,
        walls_misfit=tubes.reduced_chi2,
    )


def _overlap_report(
    edge: registration.StationRegistration, names: tuple[str, ...], gap: float
) -> results.OverlapReport:
    overlap = edge.overlap
    units = np.repeat((1e3, 180 / np.pi), 3)
    covariance = edge.covariance * np.outer(units, units)
    return results.OverlapReport(
        stations=(names[overlap.first], names[overlap.second]),
        azimuth_deg=float(np.degrees(overlap.arc.middle_azimuth)),
        arc_deg=float(np.degrees(overlap.arc.span_angle)),
        sections=overlap.sections,
        views=len(edge.azimuth),
        left_out=int((~edge.counted).sum()),
        residual_rms_mm=1e3 * edge.residual_rms,
        misfit=edge.reduced_chi2,
        sigma_mm=1e3 * edge.position_sigma,
        covariance=tuple(map(tuple, covariance.tolist())),
        gap_mm=1e3 * gap,
    )


@dataclass(frozen=True, slots=True, eq=False)
class StationRun:
    """Run directory of one station, and what was read from it for stitching.

    Parameters
    ----------
    directory : Path
        Where it is.
    station : Station
        What was scanned.
    summary : ScanSummary
        Its scan in a few numbers.
    joint : JointDefinition or None
        The joint that its job names, for the comparison alone.
    left_out : tuple of str
        What may err by an amount that is not stated.
    devices : tuple of str
        Arm, laser and how the one sits on the other: stations with the same share their errors.
    """

    directory: Path
    station: Station
    summary: results.ScanSummary
    joint: JointDefinition | None
    left_out: tuple[str, ...] = ()
    devices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class StitchedRun:
    """A stitched groove and the run directory it was written to.

    Parameters
    ----------
    summary : ScanSummary
        The groove in a few numbers.
    report : StitchingReport
        How the stations were stitched.
    stitched : StitchedGroove
        The stations and sections in frame j.
    """

    summary: results.ScanSummary
    report: results.StitchingReport
    stitched: StitchedGroove


def stitch_run_directories(
    runs: Sequence[Path],
    directory: Path,
    settings: StitchSettings = DEFAULT_STITCH_SETTINGS,
    finished: WhenFinished = do_nothing,
) -> StitchedRun:
    """Stitch run directories and write the result.

    Runs from elsewhere are copied into the directory, so that it can be moved as a whole.

    Parameters
    ----------
    runs : sequence of Path
        Run directories of single stations, or one that holds such for all of its stations.
    directory : Path
        Where to write; it may be the one that holds the stations' directories.
    settings : StitchSettings
        What is assumed and what is required.
    finished : callable
        Is called with the directory once the results are written.

    Raises
    ------
    StitchingRefused
        If the stations can't be stitched; ``stitch.png`` in the directory shows why.
    ConfigurationError
        If a run is missing, or is not of a station.
    RecordingError
        If one can't be read, or the result can't be written.
    """
    read = name_causes_by_device(list(map(read_station_run, station_directories(runs))))
    for one, other in combinations(read, 2):
        if one.station.name == other.station.name:
            raise ConfigurationError(
                f"is of station {one.station.name}, and so is {one.directory}: leave one out or, "
                f"if they are two, rename one in its {run_files.JOB_FILE}",
                file=other.directory,
            )
    try:
        stitched = StitchedGroove([one.station for one in read], settings)
    except StitchingRefused as error:
        if isinstance(error.draft, registration.StitchingDraft):
            with write_files_atomically(directory) as draft:
                write_png(draft / run_files.STATIONS_PICTURE, draw_stitching(error.draft))
            error.add_note(f"{directory / run_files.STATIONS_PICTURE} shows it")
        raise
    joint = read[0].joint if all(one.joint == read[0].joint for one in read) else None
    _copy_runs_from_elsewhere(directory, read, joint)
    done = _write_stitched_run(directory, read, stitched, joint)
    finished(directory)
    return done


def name_causes_by_device(read: Sequence[StationRun]) -> list[StationRun]:
    """Stations of different devices, their shared errors named apart: they share none of them."""
    kinds = list(dict.fromkeys(one.devices for one in read))
    if len(kinds) < 2:
        return list(read)
    apart = []
    for one in read:
        which = f", devices {kinds.index(one.devices) + 1}"
        causes = tuple(replace(cause, name=cause.name + which) for cause in one.station.causes)
        apart.append(replace(one, station=replace(one.station, causes=causes)))
    return apart


def station_directories(runs: Sequence[Path]) -> list[Path]:
    """Run directories of single stations, as named or found in a named directory."""
    found = []
    for run in runs:
        if any(file.is_file() for file in recording_files(run)):
            found.append(run)
            continue
        # Runs that were stitched from elsewhere have no job of the whole.
        check_files_unaltered(job_file := run / run_files.JOB_FILE)
        names = read_scan_job(job_file).station_names if job_file.is_file() else ()
        folders = [run / name for name in names] or sorted(run.glob("*/scan.mcap"))
        if not folders:
            raise ConfigurationError("is no run directory, nor holds any of stations", file=run)
        found += [folder.parent if folder.is_file() else folder for folder in folders]
    return found


def read_station_run(directory: Path) -> StationRun:
    """Read the run directory of one station; raises as `stitch_run_directories` does."""
    job_file = directory / run_files.JOB_FILE
    check_files_unaltered(*(directory / name for name in RUN_INPUT_FILES))
    with add_file_to_errors(job_file):
        job = read_scan_job(job_file)
        if len(job.station) != 1:
            raise ConfigurationError(
                f"is of {len(job.station) or 'no'} station{'s' if job.station else ''}: stitching "
                "takes runs of one [[station]] each, whose pose in frame w it begins from",
                file=job_file,
                key="station",
            )
        _check_recording_is_of_job(directory, job)
        read = groove_reader_of_job(job)
        done = read_recorded_scan(directory)
        sections = finished_sections(done.reread_sections(read))
        context = ScanContext(job, job_file)
        joint = context.joint
    if not (directory / run_files.SUMMARY_FILE).is_file():
        raise ConfigurationError(
            f"its scan did not end; go on with: tjscan scan --resume {directory}", file=directory
        )
    summary = results.read_summary(directory / run_files.SUMMARY_FILE)
    results.check_recording_complete(directory, summary, len(sections))
    station = station_from_recording(job.station[0].name, job.T_w_b, sections, done.views, read)
    with add_file_to_errors(job_file):
        causes = causes_of_job(job, context.sensor_mount, station.all_sections)
    sigma = None if job.carrier is None else (job.carrier.sigma, job.carrier.angular_sigma)
    station = replace(station, causes=causes.shared, carrier_sigma=sigma)
    devices = job.arm.device_id, job.laser.device_id, str(context.sensor_mount.T_f_s.tolist())
    return StationRun(directory, station, summary, joint, causes.left_out, devices)


def _check_recording_is_of_job(directory: Path, job: ScanJob) -> None:
    """Refuse a recording from other start poses than the job's: two of them may be swapped."""
    snapshot = read_job_snapshot(directory)
    if snapshot is None:
        return
    recorded = validate_table(ScanJob, tomllib.loads(snapshot.job))
    names = recorded.station_names
    if len(names) != 1 or recorded.start_poses != job.start_poses:
        of = f"station {', '.join(map(repr, names))}" if names else "a scan without stations"
        raise ConfigurationError(
            f"its recording is of {of}, its start poses not what its {run_files.JOB_FILE} has for "
            f"{job.station[0].name!r}; put the recordings of the stations back into their own "
            "directories",
            file=directory,
        )


def _copy_runs_from_elsewhere(
    directory: Path, read: Sequence[StationRun], joint: JointDefinition | None
) -> None:
    """Copy the runs from elsewhere, and the joint, into the directory of the result."""
    with write_files_atomically(directory, listed=True) as draft:
        for one in read:
            if not _is_station_inside(directory, one):
                shutil.copytree(one.directory, draft / one.station.name)
        file = read[0].directory / run_files.JOINT_FILE
        if joint is not None and file.is_file() and not (directory / run_files.JOINT_FILE).exists():
            shutil.copyfile(file, draft / run_files.JOINT_FILE)


def _is_station_inside(directory: Path, one: StationRun) -> bool:
    return one.directory.resolve().parent == directory.resolve()


def _folder_in_result(directory: Path, one: StationRun) -> str:
    """What a station's run is called inside the result, wherever that is moved to."""
    return one.directory.resolve().name if _is_station_inside(directory, one) else one.station.name


def stitched_cloud(stitched: StitchedGroove) -> GrooveCloud:
    """All profile points of the stations, in frame j."""
    scans = [one.fit.station.sections for one in stitched.stations]
    frames = [JointOrBaseFrame(inverse_pose(one.T_j_b)) for one in stitched.stations]
    return GrooveCloud.joined(list(map(cloud_of_sections, scans, frames)))


def _write_stitched_run(
    directory: Path,
    read: Sequence[StationRun],
    stitched: StitchedGroove,
    joint: JointDefinition | None,
) -> StitchedRun:
    sections, cloud = stitched.sections, stitched_cloud(stitched)
    left_out = list(dict.fromkeys(words for one in read for words in one.left_out))
    summary = results.summarise_stations(
        {one.station.name: one.summary for one in sorted(read, key=lambda one: one.station.name)},
        sections,
        "j",
        corner_errors(sections, joint),
        closed=stitched.is_closed,
        uncertainty=summarise_budget(stitched.budget, ~absent_corners(sections), left_out),
    )
    job = run_files.job_label_of_run(directory, *(one.directory for one in read))
    provenance = Provenance.for_file_written_now(job, "j")
    sources = {one.station.name: _folder_in_result(directory, one) for one in read}
    report = replace(build_stitching_report(stitched, sources), provenance=provenance)
    picture = draw_groove_overview(
        sections,
        cloud.points,
        frame="j",
        title=f"{len(sections)} sections from {len(stitched.stations)} stations, "
        f"{report.covered_deg:.0f}° covered",
        outline=() if joint is None else joint_wireframe(joint),
        paths=[
            transform_points(one.T_j_b, [s.view.T_b_f[:3, 3] for s in one.fit.station.sections])
            for one in stitched.stations
        ],
    )
    with write_files_atomically(directory, listed=True) as draft:
        results.write_stitching_report(draft / run_files.STATIONS_FILE, report)
        write_png(draft / run_files.STATIONS_PICTURE, draw_stitching(stitched.draft), provenance)
    budget = stitched.budget
    summary = write_run_results(directory, sections, cloud, summary, picture, job, budget)
    return StitchedRun(summary, report, stitched)
