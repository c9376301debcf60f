"""A chain: calibrate, scan from several stations, stitch, and compare with the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from annotated_types import Gt, Le
from pydantic import Field

from tjscan.calibration.wizard.operator import DefaultAnswerOperator
from tjscan.comparison.alignment import align_icp
from tjscan.comparison.distance import MeshDistance, corner_to_edge_distances
from tjscan.core.config import StrictFileModel, read_toml, validate_table
from tjscan.core.errors import CalibrationRefused, ConfigurationError, StitchingRefused
from tjscan.core.frames import Array, transform_points
from tjscan.core.pose_vector import boxminus
from tjscan.core.units import DEG, MM, SettingsTable, pose_from_rows_mm
from tjscan.job.files import read_calibration_job, read_scan_job
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import feature_edges
from tjscan.joint.mesh import build_joint_mesh
from tjscan.joint.tubes.fit import ArmRepeatability
from tjscan.recording.header import flatten_to_dotted_keys
from tjscan.recording.journal import CombinedJournal
from tjscan.result.section import absent_corners
from tjscan.runs.calibration.run import start_calibration
from tjscan.runs.scan.run import ScanContext, groove_reader_of_job, scan_in_cell
from tjscan.runs.scan.uncertainty import causes_of_job
from tjscan.runs.stations.stitch import stitched_cloud
from tjscan.stitching.stations import Station, StitchSettings, station_from_recording
from tjscan.stitching.stitch import StitchedGroove

TABLES_SHARED_BY_JOBS: Final = ("arm.", "laser.", "simulation.")
"""Tables that both jobs have in common: they are of one cell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewErrorSettings(SettingsTable):
    """The table [stitch]: what arm and laser err by from view to view, root mean square.

    Parameters
    ----------
    repeatability, angular_repeatability : float
        Of position and angle, metres and radians. An arm whose geometry is off errs by more than
        it does not repeat.
    """

    repeatability: Annotated[float, Gt(0), Le(5), MM] = 5e-5
    angular_repeatability: Annotated[float, Gt(0), Le(1), DEG.with_key("repeatability_deg")] = 1e-4


class ChainFile(StrictFileModel):
    """A chain: the job that calibrates, the job that scans, and what is set in both.

    Parameters
    ----------
    calibrate, scan : str
        Paths of the jobs, counted from the file's folder.
    stitch : ViewErrorSettings
        What arm and laser err by from view to view, for stitching.
    both : dict
        Keys of both jobs, of their tables [arm], [laser] and [simulation].
    calibration : dict
        Keys of the job that calibrates.
    """

    calibrate: str
    scan: str
    stitch: ViewErrorSettings = ViewErrorSettings()
    both: dict[str, Any] = Field(default_factory=dict)
    calibration: dict[str, Any] = Field(default_factory=dict)

    def with_shared_keys(self, keys: dict[str, Any]) -> ChainFile:
        """Return the same chain with other values of some dotted keys of both jobs."""
        return self.model_copy(update={"both": self.both | keys})


def read_chain_file(file: Path) -> ChainFile:
    """Read a chain's file: its jobs as paths from here, its keys dotted.

    Raises
    ------
    ConfigurationError
        If it can't be read, or sets a key for both jobs that is not of the cell.
    """
    read = validate_table(ChainFile, read_toml(file), file)
    both = flatten_to_dotted_keys(read.both)
    for key in both:
        if not key.startswith(TABLES_SHARED_BY_JOBS):
            raise ConfigurationError(
                "is not of the cell that both jobs share; that has [both.arm], [both.laser] "
                "and [both.simulation]",
                file=file,
                key=f"both.{key}",
            )
    jobs = {name: str(file.parent / getattr(read, name)) for name in ("calibrate", "scan")}
    calibration = flatten_to_dotted_keys(read.calibration)
    return read.model_copy(update={**jobs, "both": both, "calibration": calibration})


CALIBRATION_RUN_FOLDER: Final = "calibrate"
"""Name of the calibration's run directory."""


@dataclass(frozen=True, slots=True, eq=False)
class ChainOutcome:
    """What came of a chain.

    Parameters
    ----------
    stitched : StitchedGroove
        The groove of all stations, with what is stated of its uncertainty.
    in_own_frame : ndarray, shape (n,)
        Distances of the corners from the joint's feature edges, in its frame as found from its
        tubes, metres.
    corner_errors : ndarray, shape (n,)
        The same once all that was seen is aligned to the joint as designed, metres.
    mount_error : ndarray, shape (6,)
        Of T_f_s: translation (metres) and rotation (radians) in the axes of f.
    mount_covariance : ndarray, shape (6, 6)
        As the calibration states it.
    held_out : tuple of float or None
        RMS distance of the ball in postures that took no part, without and with the deviations of
        the arm found, metres; None if the arm was not calibrated.
    """

    stitched: StitchedGroove
    in_own_frame: Array
    corner_errors: Array
    mount_error: Array
    mount_covariance: Array
    held_out: tuple[float, float] | None

    @property
    def mean_corner_error(self) -> float:
        """Mean distance of the corners from the edges, aligned to the joint, metres."""
        return float(np.mean(self.corner_errors))

    @property
    def mean_own_frame_error(self) -> float:
        """Mean distance of the corners from the edges in the frame of the tubes, metres."""
        return float(np.mean(self.in_own_frame))

    @property
    def p95_corner_error(self) -> float:
        """Distance that 95 % of the corners stay within, metres."""
        return float(np.percentile(self.corner_errors, 95))

    @property
    def mount_nees(self) -> float:
        """Error of T_f_s squared over its covariance, by its six dimensions: about one if true."""
        d = self.mount_error
        return float(d @ np.linalg.solve(self.mount_covariance, d) / 6)


def run_chain(chain: ChainFile, directory: Path, *, arm: bool) -> ChainOutcome:
    """Calibrate, scan from all stations, stitch and compare.

    Parameters
    ----------
    chain : ChainFile
        What to run; all of it simulated.
    directory : Path
        Gets the calibration's run directory, `CALIBRATION_RUN_FOLDER`.
    arm : bool
        Whether the arm is calibrated with the sensor.

    Raises
    ------
    TjscanError
        As calibration, scan and stitching do.
    """
    out, operator = directory / CALIBRATION_RUN_FOLDER, DefaultAnswerOperator()
    calibrate, scan = Path(chain.calibrate), Path(chain.scan)
    job = read_calibration_job(calibrate, chain.both | chain.calibration)
    saved = start_calibration(job, calibrate, out, operator, arm=arm)
    truth = None if job.simulation is None else job.simulation.T_f_s_mm
    if truth is None:
        reason = "a chain compares with the truth: it needs it"
        raise ConfigurationError(reason, file=calibrate, key="simulation.T_f_s_mm")
    keys = chain.both | {"calibration.file": str(saved.file.absolute())}
    whole = ScanContext(read_scan_job(scan, keys), scan)
    if (joint := whole.joint) is None:
        raise ConfigurationError("a chain compares with the joint", file=scan, key="joint")
    stations = [_scan_from_station(whole.at_station(name)) for name in whole.job.station_names]
    errors = chain.stitch
    repeatability = ArmRepeatability(errors.repeatability, errors.angular_repeatability)
    stitched = StitchedGroove(stations, StitchSettings(repeatability=repeatability))
    mesh = build_joint_mesh(joint)
    surface = MeshDistance(mesh.vertices, mesh.triangles.astype(np.intp))
    seen = stitched_cloud(stitched).points
    aligned = align_icp(seen, surface.nearest_points_and_normals)
    found, held_out = saved.calibration, None
    if (kinematics := found.kinematics) is not None:
        held_out = 1e-3 * kinematics.held_out_before_mm, 1e-3 * kinematics.held_out_after_mm
    own, corners = (_corner_errors(stitched, T, joint) for T in (np.eye(4), aligned.T))
    mount_error = boxminus(found.T_f_s, pose_from_rows_mm(truth))
    return ChainOutcome(stitched, own, corners, mount_error, found.covariance_si, held_out)


def _scan_from_station(context: ScanContext) -> Station:
    job, read = context.job, groove_reader_of_job(context.job)
    found = scan_in_cell(context.make_cell(), job, CombinedJournal())
    name = job.station[0].name
    station = station_from_recording(name, job.T_w_b, found.sections, found.views, read)
    causes = causes_of_job(job, context.sensor_mount, station.all_sections)
    return replace(station, causes=causes.shared)


def _corner_errors(stitched: StitchedGroove, T: Array, joint: JointDefinition) -> Array:
    """Distances of the corners from the joint's edges, once `T` has moved them; metres."""
    corners = np.array([transform_points(T, section.points) for section in stitched.sections])
    absent = absent_corners(stitched.sections)
    errors = corner_to_edge_distances(corners, feature_edges(joint), absent)
    return np.asarray(errors[np.isfinite(errors)])


def mount_error_in_words(outcome: ChainOutcome) -> str:
    """How far T_f_s is off, in millimetres and degrees."""
    position = 1e3 * float(np.linalg.norm(outcome.mount_error[:3]))
    turn = float(np.degrees(np.linalg.norm(outcome.mount_error[3:])))
    return f"{position:.3f} mm, {turn:.3f}°"


def _dotted_simulation_keys(table: str, *keys: str) -> tuple[str, ...]:
    return tuple(f"simulation.{table}.{key}" for key in keys)


KEYS_OF_ERROR_SOURCES: Final[Mapping[str, tuple[str, ...]]] = {
    "arm: zeros, lengths, twists": _dotted_simulation_keys(
        "arm.errors", "offset_deg", "length_mm", "twist_deg"
    ),
    "arm: gears": _dotted_simulation_keys("arm.errors", "eccentricity_deg", "backlash_deg"),
    "arm: warmth": _dotted_simulation_keys("arm.errors", "growth"),
    "arm: repeatability": _dotted_simulation_keys("arm", "repeatability_mm", "repeatability_deg"),
    "laser: scale, tilt, lens": _dotted_simulation_keys("laser", "linearity_mm"),
    "laser: noise, bias, outliers": _dotted_simulation_keys(
        "laser", "noise_mm", "bias_mm", "ghosts", "flyers", "missing"
    ),
}
"""Sources of error, and the keys that switch each of them off if they are zero."""

ALL_ERROR_SOURCES: Final = "all together"
NO_ERROR_SOURCE: Final = "none: touches, reading and stitching alone"


@dataclass(frozen=True, slots=True)
class ErrorSourceRow:
    """What is left with one source of error alone.

    Parameters
    ----------
    source : str
        Its name, or `ALL_ERROR_SOURCES`, or `NO_ERROR_SOURCE`.
    directory : Path
        With the calibration's run directory, `CALIBRATION_RUN_FOLDER`.
    outcome : ChainOutcome or None
        What came of the chain; None if it was refused.
    refusal : str
        Why; empty if it was not.
    """

    source: str
    directory: Path
    outcome: ChainOutcome | None
    refusal: str = ""


def run_error_sources(
    chain: ChainFile,
    directory: Path,
    *,
    arm: bool,
    begin: Callable[[str], None],
    alone: bool = True,
) -> Iterator[ErrorSourceRow]:
    """Run a chain with all its errors, then with each source alone, then with none.

    Parameters
    ----------
    chain : ChainFile
        What to run.
    directory : Path
        Gets a directory for each.
    arm : bool
        Whether the arm is calibrated with the sensor.
    begin : callable
        Receives the name of each source before its chain runs.
    alone : bool
        Whether to run each source alone, or all of them together and no more.
    """
    everything = [key for keys in KEYS_OF_ERROR_SOURCES.values() for key in keys]
    runs: dict[str, dict[str, Any]] = {ALL_ERROR_SOURCES: {}}
    if alone:
        for source, keys in KEYS_OF_ERROR_SOURCES.items():
            runs[source] = {key: 0.0 for key in everything if key not in keys}
        runs[NO_ERROR_SOURCE] = dict.fromkeys(everything, 0.0)
    for number, (source, zeros) in enumerate(runs.items()):
        begin(source)
        own = directory / str(number)
        try:
            outcome = run_chain(chain.with_shared_keys(zeros), own, arm=arm)
            yield ErrorSourceRow(source, own, outcome)
        except (CalibrationRefused, StitchingRefused) as refused:
            yield ErrorSourceRow(source, own, None, str(refused))
