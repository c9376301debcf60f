"""Run a chain once: calibrate, scan from all stations, stitch, and hold it against the joint."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from tjscan.calibration.file import CalibrationFile
from tjscan.calibration.wizard.operator import DefaultAnswerOperator, Operator
from tjscan.comparison.alignment import Alignment, align_icp, nearest_point_finder_on_mesh
from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.comparison.surface import MeshDistance
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, JointOrBaseFrame, inverse_pose, transform_points
from tjscan.core.pose_vector import boxminus
from tjscan.core.units import pose_from_rows_mm
from tjscan.job import ScanJob, read_calibration_job, read_scan_job
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import feature_edges
from tjscan.joint.mesh import build_joint_mesh
from tjscan.result.section import absent_corners
from tjscan.runs.calibration.run import start_calibration
from tjscan.runs.chain.settings import Chain
from tjscan.runs.context import RunContext, groove_reader_of_job
from tjscan.runs.scan.results import all_profile_points
from tjscan.runs.scan.run import scan_in_cell
from tjscan.runs.uncertainty import causes_of_job
from tjscan.scanning.journal import CombinedJournal
from tjscan.stitching.stations import Station, StitchSettings, station_from_recording
from tjscan.stitching.stitch import StitchedGroove, stitch_stations

CALIBRATION_RUN: Final = "calibrate"
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
        Of T_f_s: translation (metres) and rotation (radians) in the axes of f; zero where it was
        given.
    mount_covariance : ndarray, shape (6, 6), or None
        As the calibration states it; None where T_f_s was given.
    held_out : tuple of float or None
        RMS distance of the ball in postures that took no part, without and with the deviations of
        the arm found, metres; None where the arm was not calibrated.
    """

    stitched: StitchedGroove
    in_own_frame: Array
    corner_errors: Array
    mount_error: Array
    mount_covariance: Array | None
    held_out: tuple[float, float] | None

    @property
    def corners_mean(self) -> float:
        """Mean distance of the corners from the edges, aligned to the joint, metres."""
        return float(np.mean(self.corner_errors))

    @property
    def in_own_frame_mean(self) -> float:
        """Mean distance of the corners from the edges in the frame of the tubes, metres."""
        return float(np.mean(self.in_own_frame))

    @property
    def corners_p95(self) -> float:
        """Distance that 95 % of the corners stay within, metres."""
        return float(np.percentile(self.corner_errors, 95))

    @property
    def mount_nees(self) -> float | None:
        """Error of T_f_s squared over its covariance, by its six dimensions: about one if true."""
        if self.mount_covariance is None:
            return None
        d = self.mount_error
        return float(d @ np.linalg.solve(self.mount_covariance, d) / 6)


def run_chain(
    chain: Chain,
    directory: Path,
    *,
    arm: bool,
    mount_given: bool = False,
    operator: Operator | None = None,
) -> ChainOutcome:
    """Calibrate, scan from all stations, stitch and compare.

    Parameters
    ----------
    chain : Chain
        What to run; all of it simulated.
    directory : Path
        Gets the calibration's run directory, `CALIBRATION_RUN`.
    arm : bool
        Whether the arm is calibrated with the sensor.
    mount_given : bool
        Whether the scan takes the true T_f_s, and nothing is calibrated.
    operator : Operator, optional
        Watches the calibration; nobody where left out.

    Raises
    ------
    TjscanError
        As calibration, scan and stitching do.
    """
    found, error, keys = None, np.zeros(6), dict(chain.both)
    if not mount_given:
        out = directory / CALIBRATION_RUN
        job = read_calibration_job(chain.calibrate, chain.both | chain.calibration)
        saved = start_calibration(
            job, chain.calibrate, out, operator or DefaultAnswerOperator(), arm=arm
        )
        found = saved.calibration
        keys["calibration.file"] = str(saved.file.absolute())
        truth = None if job.simulation is None else job.simulation.T_f_s_mm
        if truth is None:
            raise ConfigurationError(
                "a chain compares with the truth: it needs it",
                file=chain.calibrate,
                key="simulation.T_f_s_mm",
            )
        error = boxminus(found.T_f_s, pose_from_rows_mm(truth))
    joint = RunContext(read_scan_job(chain.scan, keys), chain.scan).joint
    if joint is None:
        raise ConfigurationError("a chain compares with the joint", file=chain.scan, key="joint")
    stitched = _stitched(chain, keys)
    aligned = align_to_joint(stitched, joint)
    return ChainOutcome(
        stitched,
        _corner_errors(stitched, np.eye(4), joint),
        _corner_errors(stitched, aligned.T, joint),
        error,
        None if found is None else found.covariance_si,
        _held_out(found),
    )


def align_to_joint(stitched: StitchedGroove, joint: JointDefinition) -> Alignment:
    """Align all points that were seen to the joint as designed, by iterated closest points."""
    mesh = build_joint_mesh(joint)
    points = [
        all_profile_points(one.station.sections, JointOrBaseFrame(inverse_pose(one.T_j_b)))
        for one in stitched.stations
    ]
    surface = MeshDistance(mesh.vertices, mesh.triangles.astype(np.intp))
    return align_icp(np.concatenate(points), nearest_point_finder_on_mesh(surface))


def _held_out(found: CalibrationFile | None) -> tuple[float, float] | None:
    if found is None or found.kinematics is None:
        return None
    arm = found.kinematics
    return 1e-3 * arm.held_out_before_mm, 1e-3 * arm.held_out_after_mm


def _stitched(chain: Chain, keys: dict[str, Any]) -> StitchedGroove:
    whole = read_scan_job(chain.scan, keys)
    stations = [_station(whole, name, chain.scan) for name in whole.station_names]
    return stitch_stations(stations, StitchSettings(repeatability=chain.repeatability))


def _station(whole: ScanJob, name: str, file: Path) -> Station:
    job = whole.job_at_station(name)
    context = RunContext(job, file)
    result = scan_in_cell(context.make_cell(), job, CombinedJournal())
    station = station_from_recording(
        name, job.T_w_b, result.sections, result.views, groove_reader_of_job(job)
    )
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
