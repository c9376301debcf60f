"""Commands about scans: of a groove, of its start poses and its cell, and from several stations."""

from __future__ import annotations

from json import dumps
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from tjscan.cli.options.shared import JobKeys, LiveScanOptions, parse_overrides
from tjscan.cli.output.console import print_message, show_phase
from tjscan.core.errors import ConfigurationError
from tjscan.result.directory import default_run_directory

if TYPE_CHECKING:
    from tjscan.stitching.stations import StitchSettings


def scan(
    job: Path,
    *overrides: JobKeys,
    station: str | None = None,
    out: Path | None = None,
    resume: bool = False,
    dry_run: bool = False,
    realtime: bool = False,
    json: bool = False,
    page: LiveScanOptions | None = None,
) -> None:
    """Scan a groove as a job file states.

    Ctrl-C ends the scan after the section under way; twice, it stops the arm at once. Either way
    --resume goes on from there.

    Every key of the job file is an option too, as in
    ``tjscan scan examples/paper.toml --scan.step-mm 20``. Those that are changed most:

    - ``--scan.step-mm``: distance from section to section
    - ``--scan.length-mm``, ``--scan.sections``: where to end
    - ``--scan.standoff-mm``, ``--scan.pull-angle-deg``: how the laser looks at the groove
    - ``--scan.prediction-case``: how the next section is predicted
    - ``--arm.driver``, ``--arm.ur.host``, ``--arm.speed-mm-s``: the arm
    - ``--laser.driver``: the laser
    - ``--station.left.length-mm``: the same keys for one station
    - ``--simulation.seed``: other faults of the simulated cell

    Exit codes: 0 done, 1 ended before it was complete, 2 a mistake in job or options, 4 a fault of
    arm or laser, 130 interrupted.

    Parameters
    ----------
    job
        The job file (TOML); with --resume the run directory to go on in.
    station
        The one station to scan from, of a job with several; all of them if left out.
    out
        The run directory to make; ``runs/JOB-DATE`` if left out.
    resume
        Go on with an interrupted scan, after its last finished section, and with stations that
        are still to be scanned.
    dry_run
        Check the job and the whole way to the taught poses, and move nothing.
    realtime
        Let a simulated arm take its time; short for ``--simulation.arm.realtime true``.
    json
        Print the summary as JSON on stdout.
    """
    from tjscan.job.files import read_scan_job

    keys = parse_overrides(overrides) | ({"simulation.arm.realtime": True} if realtime else {})
    file = job / "job.toml" if resume else job
    parsed = read_scan_job(file, keys)
    page = page or LiveScanOptions()
    page.check_options()
    # A job with a mistake in it is refused before anything heavy is loaded.

    with show_phase("loading arm and laser"):
        from tjscan.cli.output.scan import ScanRequest, check_job_only, run_scan_request

    if resume and (out is not None or dry_run):
        raise ConfigurationError("--resume goes on in the run directory: no --out, no --dry-run")
    if dry_run:
        check_job_only(parsed, file, station)
        return
    directory = file.parent if resume else out or default_run_directory(file, station)
    request = ScanRequest(parsed, file, keys, station, directory, page, resume=resume, json=json)
    run_scan_request(request)


def teach(
    job: Path,
    *overrides: JobKeys,
    which: Literal["first", "second"],
    station: str | None = None,
    lead_mm: tuple[float, float, float] | None = None,
    json: bool = False,
) -> None:
    """Write the arm's pose into a job file as a start pose, if the laser sees a groove.

    Lead the arm there by hand or pendant before; nothing moves. Comments in the file stay. Every
    key of the job file is an option too, for this once.

    Parameters
    ----------
    job
        The job file (TOML), which is changed.
    which
        The first or the second start pose.
    station
        Station of the arm, if the job has several.
    lead_mm
        Lead a simulated arm, which no hand can: to the pose in the job, moved by this
        much along the flange's axes. ``--lead-mm 3 0 -2``
    json
        Print the pose as JSON on stdout.
    """
    from tjscan.core.config import add_file_to_errors
    from tjscan.job.files import read_scan_job
    from tjscan.result.readings import measures_with_sigmas
    from tjscan.runs.teach import teach_pose

    with add_file_to_errors(job):
        here = read_scan_job(job, parse_overrides(overrides)).job_at_station(station)
    lead = None if lead_mm is None else [1e-3 * value for value in lead_mm]
    taught = teach_pose(here, job, which, lead)
    position, angles = taught.position_mm, taught.euler_zyx_deg
    if json:
        pose = {"which": which, "position_mm": position, "euler_zyx_deg": angles}
        print(dumps(pose, indent=2))
    measures = measures_with_sigmas(taught.groove)
    seen = ", ".join(f"{name} {value:.2f}" for name, value, _ in measures)
    print_message(f"the laser sees a groove there: {seen}")
    print_message(f"{job}: {'.'.join(taught.key)} is now {list(position)} mm, {list(angles)}°")


def doctor(
    job: Path,
    *overrides: JobKeys,
    station: str | None = None,
    json: bool = False,
) -> None:
    """Check a job's cell: files, arm, laser, and the way to its start poses. Nothing moves.

    Parameters
    ----------
    job
        The job file (TOML).
    station
        Station of the arm, if the job has several.
    json
        Print the findings as JSON on stdout.
    """
    from tjscan.cli import exit_code_of_error
    from tjscan.runs.doctor import check_job_and_cell

    findings = []
    for finding in check_job_and_cell(job, parse_overrides(overrides), station):
        findings.append(finding)
        if not json:
            mark = "ok   " if finding.passed else "WRONG"
            print(f"{mark} {finding.what}: {' '.join(finding.detail.split())}", flush=True)
    if json:
        rows = [{"what": f.what, "sound": f.passed, "detail": f.detail} for f in findings]
        print(dumps(rows, indent=2))
    codes = {exit_code_of_error(finding.error) for finding in findings if finding.error is not None}
    # A configuration comes first: nothing runs before it is right.
    raise SystemExit(2 if 2 in codes else max(codes, default=0))


def laser(
    job: Path,
    *overrides: JobKeys,
    profiles: Annotated[int | None, Parameter(validator=Number(gte=1))] = None,
    write: Path | None = None,
    json: bool = False,
) -> None:
    """Show what a line laser sees, live, with the groove that is read in it. No arm is needed.

    Of the job file only [laser] and [groove] count. Ctrl-C ends it. Every key of the job file is
    an option too.

    Parameters
    ----------
    job
        The job file (TOML).
    profiles
        How many to take; left out, until interrupted.
    write
        Write the profiles into this new text file, which 'tjscan groove' reads.
    json
        Print a line of JSON for each profile on stdout.
    """
    from contextlib import ExitStack
    from itertools import islice

    from tjscan.cli.output.results import print_laser_description, show_live_readings
    from tjscan.runs.laser import open_laser_of_job, open_profile_file, read_live_profiles

    with ExitStack() as stack:
        device, settings = stack.enter_context(open_laser_of_job(job, parse_overrides(overrides)))
        keep = None if write is None else stack.enter_context(open_profile_file(write))
        print_laser_description(device)
        show_reading = stack.enter_context(show_live_readings(json=json))
        for reading in islice(read_live_profiles(device, settings), profiles):
            show_reading(reading)
            if keep is not None:
                keep(reading.profile)


def reprocess(
    run: Path,
    *overrides: JobKeys,
    out: Path | None = None,
    json: bool = False,
) -> None:
    """Read a run's recorded profiles again with other settings, into a new directory.

    Keys of the job for reading profiles are options: ``--groove.noise-mm 0.1``; so is
    ``--calibration.file``. The run itself stays as it is.

    Parameters
    ----------
    run
        The run directory, whole or cut short, of one station or of several.
    out
        The directory to make; ``RUN-DATE`` beside the run if left out.
    json
        Print the summary as JSON on stdout.
    """
    keys = parse_overrides(overrides)
    with show_phase("reading the profiles again"):
        from tjscan.cli.output.scan import print_scan_summary, print_stitched_groove
        from tjscan.report.write import write_run_report
        from tjscan.runs.scan.reprocess import reprocess_run as read_again

        done = read_again(run, keys, out, write_run_report)
    for one in done.stations:
        for index, error in one.lost.items():
            print_message(f"section {index}: {error}")
        for damage in one.damages:
            print_message(str(damage))
    if done.stitched is not None:
        print_stitched_groove(done.stitched, done.directory, json=json)
        return
    for one in done.stations:
        print_scan_summary(one.summary, one.directory, json=json)
    if not all(one.is_whole for one in done.stations):
        raise SystemExit(1)


def stitch(
    run: Path,
    *runs: Path,
    out: Path | None = None,
    repeatability_mm: float = 0.05,
    repeatability_deg: float = 0.0057,
    out_of_round_mm: float = 0.02,
    json: bool = False,
) -> None:
    """Stitch what was scanned from several stations into one groove, in the joint's own frame.

    Parameters
    ----------
    run
        The run directory of one station, or one that holds the runs of all stations.
    runs
        Further run directories of single stations.
    out
        The directory to make; ``runs/stitched-DATE`` if left out.
    repeatability_mm
        Root mean square error of the position that the arm reports.
    repeatability_deg
        The same of its orientation.
    out_of_round_mm
        Deviation of the tubes' walls from a circle that is assumed at least; a larger one is
        estimated from the scans.
    json
        Print the summary and the stations as JSON on stdout.
    """
    with show_phase("loading what stitches"):
        from tjscan.cli.output.scan import print_stitched_groove
        from tjscan.report.write import write_run_report
        from tjscan.runs.stations.stitch import stitch_run_directories

    directory = out or default_run_directory(Path("stitched"))
    if directory.exists() and any(directory.iterdir()):
        raise ConfigurationError(
            "is not empty; a result never overwrites another. Choose another --out", file=directory
        )
    settings = _stitch_settings(repeatability_mm, repeatability_deg, out_of_round_mm)
    with show_phase("stitching"):
        done = stitch_run_directories((run, *runs), directory, settings, write_run_report)
    print_stitched_groove(done, directory, json=json)


def _stitch_settings(
    repeatability_mm: float, repeatability_deg: float, out_of_round_mm: float
) -> StitchSettings:
    from tjscan.joint.tubes.fit import ArmRepeatability
    from tjscan.stitching.stations import DEFAULT_STITCH_SETTINGS, StitchSettings

    for name, value, most in (
        ("repeatability-mm", repeatability_mm, 5.0),
        ("repeatability-deg", repeatability_deg, 1.0),
        ("out-of-round-mm", out_of_round_mm, 1e3 * DEFAULT_STITCH_SETTINGS.most_out_of_round),
    ):
        if not 0 < value <= most:
            raise ConfigurationError(f"must be more than 0, {most:g} at most", key=f"--{name}")
    repeatability = ArmRepeatability(1e-3 * repeatability_mm, radians(repeatability_deg))
    return StitchSettings(repeatability, 1e-3 * out_of_round_mm)
