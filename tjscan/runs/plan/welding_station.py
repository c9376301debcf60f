"""An arm at a station of a run, with the torch of a WPS on its flange."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.config import add_file_to_errors
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, inverse_pose, pose_from_euler_zyx, transform_points
from tjscan.job import ScanJob, read_scan_job
from tjscan.job.arm import kinematics_of_job, solids_in_base
from tjscan.planning.wps import TorchSettings
from tjscan.result.directory import JOB
from tjscan.result.stitching import read_stitching_report
from tjscan.robot.collision import SEEN, CollisionModel
from tjscan.robot.deviations import with_deviations
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.tool_reach import Hindrance
from tjscan.runs.context import RunContext
from tjscan.scanning.scanned_surface import grid_triangles

ARM: Final = "arm"
"""Stands for the name of a station where a job has none."""


@dataclass(frozen=True, slots=True, eq=False)
class WeldingStation:
    """An arm where it stood when the groove was scanned.

    Parameters
    ----------
    name : str
        Of the station; `ARM` for a job without stations.
    job : ScanJob
        Of that station alone.
    job_file : Path
        Where it was read from.
    model, kinematics : Kinematics
        The arm as its controller has it, and as it was calibrated.
    T_b_r : ndarray, shape (4, 4)
        Frame of the run's sections in the arm's base frame.
    """

    name: str
    job: ScanJob
    job_file: Path
    model: Kinematics
    kinematics: Kinematics
    T_b_r: Array

    def hindrance(self, torch: TorchSettings, groove: Array, reserve: float) -> Hindrance:
        """What keeps the arm with a torch from standing somewhere.

        The solids of the job, where frame w is known to stand if the job says where the joint is in
        it; the arm itself; and the measured groove. A solid of the torch that enters the groove is
        held against that alone.

        Parameters
        ----------
        torch : TorchSettings
            The torch and its mount, in place of what the job has the arm carry.
        groove : ndarray, shape (k, 5, 3)
            The groove's surface: five points of each of k sections, in frame r, metres.
        reserve : float
            How much further apart than the margins, metres.
        """
        table, T_b_w = self.job.clearance, None
        if self.job.joint is not None and self.job.station:
            T_b_w = self.T_b_r @ inverse_pose(self.job.joint.T_w_j)
        model = CollisionModel(
            self.kinematics,
            solids_in_base(self.job, T_b_w),
            [one.solid for one in torch.solid],
            self_collision=table.self_collision,
            ignored=table.ignore,
        )
        surface = transform_points(self.T_b_r, groove.reshape(-1, 3))
        model.set_measured_surface(surface, grid_triangles(*groove.shape[:2]))
        of_torch = {one.name: one.in_groove for one in torch.solid}

        def least(moving: str, other: str, *, own: bool) -> float:
            if own:
                return table.own
            if of_torch.get(moving):
                return 0.0 if other == SEEN else -np.inf
            return torch.margin if moving in of_torch else table.solids

        pairs = model.pairs
        margins = np.array([least(p.moving, p.other, own=p.own) for p in pairs])
        check = model.make_check(margins + reserve)

        def hindrance(q: Array) -> str:
            near = check(q)
            return "" if near is None else f"{near.moving} would touch {near.other}"

        return hindrance

    def as_told(self, T_b_f: Array, q: Array) -> Array:
        """What the controller is to be told so that the flange truly gets to a pose; (4, 4)."""
        if self.kinematics is self.model:
            return T_b_f
        return np.asarray(T_b_f @ inverse_pose(self.kinematics.forward(q)) @ self.model.forward(q))


def welding_stations(directory: Path, frame: str) -> tuple[WeldingStation, ...]:
    """Arms of a run, at the stations from which it was scanned, in the order of its job.

    Parameters
    ----------
    directory : Path
        The run directory, of one scan or stitched.
    frame : str
        Letter of the frame of its sections.

    Raises
    ------
    ConfigurationError
        If the run does not say where its arm stood, or that can't be read.
    """
    report = read_stitching_report(directory)
    if report is None:
        job = _job(directory)
        T_b_r = np.eye(4)
        if frame == "j":
            if job.joint is None or job.station:
                raise ConfigurationError("does not say where the joint stands", key="joint")
            T_b_r = job.joint.T_w_j
        return (_station(job.station_names[0] if job.station else ARM, job, directory, T_b_r),)
    order = _job(directory).station_names if (directory / JOB).is_file() else ()
    found = []
    for one in report.stations:
        folder = directory / one.source
        T_j_b = pose_from_euler_zyx(1e-3 * np.array(one.position_mm), np.radians(one.euler_zyx_deg))
        found.append(_station(one.name, _job(folder), folder, inverse_pose(T_j_b)))
    return tuple(sorted(found, key=lambda s: order.index(s.name) if s.name in order else 0))


def _station(name: str, job: ScanJob, folder: Path, T_b_r: Array) -> WeldingStation:
    with add_file_to_errors(folder / JOB):
        model = kinematics_of_job(job)
        deviations = RunContext(job, folder / JOB).sensor_mount.deviations
    calibrated = model if deviations is None else with_deviations(model, deviations)
    return WeldingStation(name, job, folder / JOB, model, calibrated, T_b_r)


def _job(folder: Path) -> ScanJob:
    if not (folder / JOB).is_file():
        raise ConfigurationError("the run holds no job that says where its arm stood", file=folder)
    return read_scan_job(folder / JOB)
