"""Commands about what runs left: read, compared, exported, reported and shown."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from cyclopts import Parameter

from tjscan.cli.options.shared import PageOptions, ProfileFileOptions
from tjscan.cli.output.console import print_message, show_phase
from tjscan.core.errors import ConfigurationError
from tjscan.core.signals import wait_for_ctrl_c
from tjscan.result.directory import JOB_FILE, SUMMARY_FILE

if TYPE_CHECKING:
    from tjscan.groove.settings import GrooveSettings
    from tjscan.laser.files.format import FileProfiles


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class GrooveReadingOptions:
    """Options for reading grooves, each a key of a job's [groove] table.

    Parameters
    ----------
    model
        Shape of the groove; tee. The others give corners and no measures.
    noise_mm
        Largest standard deviation of the range that is expected; 0.05.
    minimum_points
        Fewest points of a profile that are worth a search; 80.
    largest_sigma_mm
        Largest standard deviation of a corner that is still accepted; 0.6.
    largest_rms_mm
        Largest deviation of the points from the fitted sides; 0.15.
    inlier_share
        Least share of a side's points that must lie on it; 0.1.
    """

    model: Literal["tee", "butt-v", "butt-v-sharp"] | None = None
    noise_mm: float | None = None
    minimum_points: int | None = None
    largest_sigma_mm: float | None = None
    largest_rms_mm: float | None = None
    inlier_share: float | None = None


def groove(
    file: Path,
    *,
    form: ProfileFileOptions | None = None,
    reading: GrooveReadingOptions | None = None,
    plot: Path | None = None,
    corners: bool = False,
    json: bool = False,
) -> None:
    """Read the groove in recorded profiles: corners and measures, each with its uncertainty.

    Each profile is read by itself; a scan also knows the sections before.

    The options of the reading are the keys of a job's [groove] table. What is left out is as in
    the job of a run directory, and as in that table's defaults elsewhere.

    Parameters
    ----------
    file
        Text with columns x and z or a profile per row, NPY, PLY, a Gocator's exported
        recording, a folder of such files, or a run directory.
    plot
        Draw the profiles with their fits into this PNG.
    corners
        Print the corners, x and z in the sensor's frame, in place of the measures.
    json
        Print the readings as JSON on stdout.
    """
    with show_phase("reading the groove"):
        from tjscan.cli.output import results as output
        from tjscan.result.readings import measure_grooves

        output.check_plot_path(plot)
        settings = _groove_settings_for_file(file, reading)
        table = _read_profiles(file, form)
        readings = list(measure_grooves(table.profiles, settings))
    output.print_readings(readings, table.bad, corners=corners, json=json)
    if plot is not None:
        with show_phase("drawing the profiles"):
            output.draw_readings_png(plot, readings, settings)
    if all(reading.refusal is not None for reading in readings):
        output.suggest_height_sign(table.profiles, settings)
        raise SystemExit(1)


def _groove_settings_for_file(file: Path, options: GrooveReadingOptions | None) -> GrooveSettings:
    """Groove settings for a file: options before the job of a run directory before the defaults."""
    from tjscan.core.config import table_to_dict, validate_table
    from tjscan.groove.settings import GrooveSettings
    from tjscan.job.files import read_scan_job

    job = file / JOB_FILE
    own = table_to_dict(read_scan_job(job).groove) if job.is_file() else {}
    stated = asdict(options or GrooveReadingOptions()).items()
    return validate_table(GrooveSettings, own | {k: v for k, v in stated if v is not None})


def _read_profiles(file: Path, options: ProfileFileOptions | None) -> FileProfiles:
    """Read the profiles of a file, folder or run directory; prints what of it can't be read.

    Raises
    ------
    ConfigurationError
        If there are none.
    """
    from tjscan.cli.output.results import print_bad_rows
    from tjscan.laser.files.format import FileProfiles, ProfileFormat
    from tjscan.laser.files.read import read_profiles
    from tjscan.scanning.recording import load_profiles_of_run as read_recorded

    o = options or ProfileFileOptions()
    is_run = (file / JOB_FILE).is_file()
    form = ProfileFormat(o.units, o.pitch, tuple(o.invalid or ()), o.z_scale, o.z_offset)
    table = FileProfiles(read_recorded(file)) if is_run else read_profiles(file, form)
    print_bad_rows(file, table.bad)
    for note in table.notes:
        print_message(f"{file}: {note}")
    if not table.profiles:
        raise ConfigurationError("holds no profile that can be read", file=file)
    return table


TOLERANCE_EXIT_CODE: Final = 3
"""Exit code if the distances exceed the tolerance."""

LengthUnit = Literal["mm", "um", "m"]


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class UnstatedUnitOptions:
    """Units and frame of files that state none.

    Parameters
    ----------
    units
        Unit of files that state none, neither themselves nor in a sidecar NAME.json.
    reference_units
        The same for the reference, if it is another.
    frame
        Frame of files that state none: j for the joint's own, or any name.
    """

    units: LengthUnit | None = None
    reference_units: LengthUnit | None = None
    frame: str | None = None


def compare(
    measured: Path,
    reference: Path,
    *,
    align: Literal["none", "joint", "icp"] = "none",
    tolerance_mm: float | None = None,
    stated: UnstatedUnitOptions | None = None,
    plot: Path | None = None,
    json: bool = False,
) -> None:
    """Compare a run or a cloud with a mesh, a cloud or a joint.

    Parameters
    ----------
    measured
        A run directory, or a cloud: PLY, PCD, XYZ, CSV, E57.
    reference
        A joint's TOML, a mesh (STL, PLY, OBJ, 3MF, STEP), a cloud, or a joint's edges.csv.
    align
        none: both are given in one frame. joint: leg and brace are found in both and aligned.
        icp: both are nearly aligned already, and iterative closest points finds the rest.
    tolerance_mm
        Exit with 3 if the 95th percentile of the distances is larger: of a run's corners
        if they can be compared, else of the cloud.
    plot
        Draw the deviation, unwrapped over the azimuth, into this PNG.
    json
        Print the comparison as JSON on stdout.
    """
    from tjscan.cli.output.results import print_comparison
    from tjscan.comparison.compare import compare_shapes
    from tjscan.comparison.maps import check_map_file, write_deviation_map
    from tjscan.comparison.shapes import UserUnitAndFrame
    from tjscan.result.shapes import read_shape

    if plot is not None:
        check_map_file(plot)
    o = stated or UnstatedUnitOptions()
    with show_phase("comparing"):
        ours = read_shape(measured, UserUnitAndFrame(o.units, o.frame))
        theirs = read_shape(reference, UserUnitAndFrame(o.reference_units or o.units, o.frame))
        tolerance = None if tolerance_mm is None else 1e-3 * tolerance_mm
        comparison = compare_shapes(ours, theirs, align, tolerance)
    print_comparison(comparison, json=json)
    for option, unit, shapes in (
        ("--units", o.units, (ours,) if o.reference_units else (ours, theirs)),
        ("--reference-units", o.reference_units, (theirs,)),
    ):
        if unit and all(shape.stated.unit_source != "--units" for shape in shapes):
            sources = "; ".join(
                f"{s.name} is in {s.stated.unit}, as {s.stated.unit_source} states" for s in shapes
            )
            print_message(f"{option} {unit} is not used: {sources}")
    if plot is not None:
        write_deviation_map(plot, comparison.plot().figure)
        print_message(f"drawn in {plot}")
    if not comparison.passed:
        raise SystemExit(TOLERANCE_EXIT_CODE)


def export(
    run: Path,
    *,
    to: Literal["csv", "ply", "json", "weldx", "ros"],
    out: Path | None = None,
    units: Literal["mm", "m"] | None = None,
) -> None:
    """Write a run's sections for another tool: points, normals, tangents, measures, sigmas.

    Parameters
    ----------
    run
        The run directory, of one scan or stitched.
    to
        csv: a flat table. ply: points. json: a document with a schema. weldx: frames for weldx.
        ros: a folder with a PoseArray and a JointTrajectory of ROS 2, and the arm's URDF.
    out
        The file or folder to write; ``export.FORMAT`` in the run directory if left out.
    units
        Unit of its lengths, mm if left out; messages of ROS are in metres.
    """
    if to != "ros":
        from tjscan.result.export import export_run

        written = export_run(run, to, units or "mm", out)
    elif units == "mm":
        raise ConfigurationError("messages of ROS are in metres: leave it out", key="--units")
    else:
        from tjscan.runs.export_ros import export_run_to_ros

        written = export_run_to_ros(run, out)
    print_message(f"written to {written}")


def report(
    run: Path,
    *,
    reference: Path | None = None,
    tolerance_mm: float | None = None,
    units: Literal["mm", "um", "m"] | None = None,
    frame: str | None = None,
) -> None:
    """Write a run's report.html again, compared with another reference if one is given.

    If it holds a weld plan, plan.html is written again too. Of a folder of runs it writes an
    overview of them all, overview.html.

    Parameters
    ----------
    run
        The run directory, of one scan or stitched; or a folder that holds run directories.
    reference
        A joint's TOML, a mesh or a cloud, in place of the joint that the run names.
    tolerance_mm
        Report the corners that are farther from it.
    units
        Unit of a reference that states none, neither itself nor in a sidecar NAME.json.
    frame
        Frame of a reference that states none: j for the joint's own, or any name.
    """
    with show_phase("writing the report"):
        from tjscan.comparison.shapes import UserUnitAndFrame
        from tjscan.report.overview import runs_in_folder, write_overview
        from tjscan.report.plan_page import PLAN_FILE, write_plan_page
        from tjscan.report.write import write_run_report

        if reference is None and (runs := runs_in_folder(run)):
            print_message(f"written to {write_overview(run, runs)}")
            return
        if (run / PLAN_FILE).is_file():
            print_message(f"written to {write_plan_page(run)}")
            if reference is None and not (run / SUMMARY_FILE).is_file():
                return  # the plan is not in the directory of its run
        tolerance = None if tolerance_mm is None else 1e-3 * tolerance_mm
        page = write_run_report(run, reference, tolerance, UserUnitAndFrame(units, frame))
    print_message(f"written to {page}")


def view(*runs: Path, page: PageOptions | None = None) -> None:
    """Show recorded runs in a browser, with a slider; several are shown side by side.

    Parameters
    ----------
    runs
        Run directories, finished or not.
    """
    if not runs:
        raise ConfigurationError("view takes one run directory or more")
    where = (page or PageOptions()).page_address
    with show_phase("reading the recordings"):
        from tjscan.live.page import Replay
        from tjscan.runs.tasks import read_recorded_show

        shows = [read_recorded_show(run) for run in runs]
    with Replay(shows, where).page as shown:
        print_message(f"open {shown.url} in a browser; Ctrl-C ends")
        with suppress(KeyboardInterrupt):
            wait_for_ctrl_c()
