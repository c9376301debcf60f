"""The arm where a weld is made from: what it looks at, and where it truly stands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError, WeldStopped
from tjscan.core.frames import Array, Mask, inverse_pose
from tjscan.groove.measured import MeasuredSection
from tjscan.job.cell import make_cell
from tjscan.job.files import ScanJob
from tjscan.job.weld import WeldSettings
from tjscan.laser.drivers import SimulatedScene
from tjscan.laser.optics import RaycastSurface
from tjscan.planning.edges import GrooveEdges
from tjscan.planning.path import GrooveStations
from tjscan.planning.stops import StationStretch
from tjscan.power.sequence import ArcFault
from tjscan.result.summary import read_stitching_report
from tjscan.robot.arm import ArmState
from tjscan.runs.scan.run import ScanContext, result_frame_of_job
from tjscan.runs.weld import look as looking
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import ProfileView
from tjscan.welding.look import SurfaceLook
from tjscan.welding.replan import GroovePart

SAME_PLACE: Final = 1e-6
"""Metres along the groove."""


@dataclass(eq=False)
class ArmStation:
    """An arm at one place, with the part of the groove that it scanned from there.

    Parameters
    ----------
    stretch : StationStretch
        From where to where along the groove it looks.
    context : ScanContext
        Of its scan.
    stations : GrooveStations
        Sections on that stretch, their lengths growing.
    part : GroovePart
        Which of all sections these are.
    flanks : FlanksAlongGroove
        Faces of the bare groove there.
    views : list of ProfileView
        From which it scanned, one a section.
    T_r_b : ndarray, shape (4, 4)
        Its base in the frame of the results, as it is believed.
    T_b_r : ndarray, shape (4, 4)
        That frame, as the simulated world has it, in its true base.
    """

    stretch: StationStretch
    context: ScanContext
    stations: GrooveStations
    part: GroovePart
    flanks: looking.FlanksAlongGroove
    views: list[ProfileView]
    T_r_b: Array
    T_b_r: Array
    _arm: ArmState | None = None

    def look(
        self,
        surface: RaycastSurface,
        u: Array,
        toes_u: Array,
        settings: WeldSettings,
        must_stop: Callable[[], bool],
    ) -> tuple[SurfaceLook, float]:
        """Go the way of the scan again over the groove as it now is.

        Parameters
        ----------
        surface : RaycastSurface
            What a simulated laser sees, in the frame of the results.
        u : ndarray, shape (m,)
            Columns, metres.
        toes_u : ndarray, shape (k, 2)
            Of the finished weld at the sections, metres.
        settings : WeldSettings
        must_stop : callable
            Whether the operator asked for an end.

        Returns
        -------
        SurfaceLook
            At the sections of this stretch.
        float
            Time on the arm's clock, seconds.

        Raises
        ------
        WeldStopped
            If the operator asked for an end.
        """
        job, mount = self.context.job, self.context.sensor_mount
        scene = SimulatedScene(surface, self.T_b_r)
        cell = make_cell(job, mount, lambda: scene, self._arm)
        profiles = []
        with cell:
            cell.arm.move_joint_to_pose(self.views[0].T_b_f, near=self.views[0].q)
            poses = [view.T_b_f for view in self.views]
            for T_b_f in looking.interpolate_poses(poses, settings.look_step):
                if must_stop():
                    raise WeldStopped(ArcFault.STOPPED, "by the operator, during a look")
                self._arm = cell.arm.move_linear(T_b_f)
                T_r_s = self.T_r_b @ self._arm.T_b_f @ cell.T_f_s
                profile = cell.laser.capture()
                profiles.append(looking.read_steel(profile, self.flanks, T_r_s, job.groove))
            time = cell.arm.state().time
        step = settings.look_step
        return looking.surface_of_profiles(self.stations, profiles, u, toes_u, step), time


def arm_stations(
    context: ScanContext,
    directory: Path,
    edges: GrooveEdges,
    sections: Sequence[MeasuredSection],
    stations: GrooveStations,
) -> tuple[tuple[ArmStation, ...], Array]:
    """The arm at each place from which a groove was scanned, in the order of the job.

    Parameters
    ----------
    context : ScanContext
        The job of the scan.
    directory : Path
        Of the scan, from one station or stitched.
    edges, sections
        Its groove and its sections.
    stations : GrooveStations
        All of the sections at which the weld is planned.

    Returns
    -------
    tuple of ArmStation
    ndarray, shape (4, 4)
        The frame of the results in the joint's true frame, as the simulated world has it: the
        first station is taken to be where its scan believes.
    """
    report = read_stitching_report(directory)
    if report is None:
        names = context.job.station_names or ("",)
        found = {names[0]: (directory, result_frame_of_job(context.job).T_r_b)}
    else:
        by_name = {one.name: one for one in report.stations}
        found = {
            name: (directory / by_name[name].source, by_name[name].T_j_b)
            for name in context.job.station_names
        }
    arms, T_j_r = list[ArmStation](), None
    for name, (folder, T_r_b) in found.items():
        there = context.at_station(name or None)
        T_b_j = _joint_in_true_base(there.job)
        if T_j_r is None:
            T_j_r = inverse_pose(T_r_b @ T_b_j)
        seen = np.array([report is None or name in one.station.split("+") for one in sections])
        begin, end = _stretch_of_sections(edges, seen)
        part = _part_of_groove(stations.s, edges, begin, end)
        last = {view.index: view for view in read_recorded_scan(folder).views}
        arms.append(
            ArmStation(
                StationStretch(name, begin, end),
                there,
                stations.at(part.rows, part.s),
                part,
                looking.FlanksAlongGroove.of_scan(edges, sections, begin, end),
                [last[k] for k in sorted(last)],
                T_r_b,
                T_b_j @ T_j_r,
            )
        )
    return tuple(arms), np.asarray(T_j_r)


def _joint_in_true_base(job: ScanJob) -> Array:
    if job.joint is None:
        raise ConfigurationError("a simulated weld needs a [joint] table", key="joint")
    return np.asarray(inverse_pose(job.T_w_b_true) @ job.joint.T_w_j)


def _stretch_of_sections(edges: GrooveEdges, seen: Mask) -> tuple[float, float]:
    """From where to where along the groove sections lie, metres: beyond its length if it closes."""
    s = edges.sections[seen]
    if not edges.closed:
        return float(s[0]), float(s[-1])
    before = int(np.diff(s, append=s[0] + edges.length).argmax())
    s = np.concatenate((s[before + 1 :], s[: before + 1] + edges.length))
    turn = edges.length if s[0] >= edges.length else 0.0
    return float(s[0] - turn), float(s[-1] - turn)


def _part_of_groove(s: Array, edges: GrooveEdges, begin: float, end: float) -> GroovePart:
    turns = edges.length * np.arange(3 if edges.closed else 1)
    unrolled = (s + turns[:, None]).ravel()
    on = np.flatnonzero((unrolled > begin - SAME_PLACE) & (unrolled < end + SAME_PLACE))
    return GroovePart(on % len(s), unrolled[on])
