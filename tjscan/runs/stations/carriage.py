"""From station to station by a carrier.

The arm is drawn back before, the carrier's way is looked at, and its axes go the way they should.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.carrier.carrier import Carrier
from tjscan.carrier.drivers import CarrierDriverInputs
from tjscan.core import errors
from tjscan.core.config import add_file_to_errors
from tjscan.core.frames import Array, inverse_pose, pose_to_euler_zyx, transform_points, unit_vector
from tjscan.core.units import PoseSettings
from tjscan.job.carrier import CarrierSweep, carrier_of_job
from tjscan.job.cell import Cell, clear_path_planner_of_job
from tjscan.job.files import read_scan_job
from tjscan.recording.journal import RunEvent
from tjscan.recording.reader import RecordingDamage
from tjscan.result.directory import JOB_FILE
from tjscan.robot.arm import ArmState
from tjscan.runs.run import nothing_recorded_yet
from tjscan.runs.scan.run import ScanContext, groove_reader_of_job
from tjscan.scanning.journal import ScannedSurfaceObstacle
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import ScannedSection, Sections

AT_STOP_TOLERANCE: Final = 2e-4
"""Metres and radians by which a carrier that is at its stop may be beside it."""

DIRECTION_STEP: Final = 1e-3
"""Metres and radians of an axis, for its derivative."""

TELLING_SHIFT: Final = 8e-3
"""Metres across the groove by which it would seem to shift if an axis went the other way: far more
than a carrier is off at a stop, and well within a laser's window."""

TELLING_SHARE: Final = 0.5
"""Of the largest shift that any section would show."""

LEAST_TELLING_SHIFT: Final = 2e-3
"""Metres: a smaller one shows nothing, and the axis is not looked at."""

LONGEST_TELLING_STEP: Final = 0.05
"""Metres and radians that an axis moves for it."""

MOST_SHARE_OF_MIRRORED: Final = 0.5
"""Of the shift that a reversed axis shows: an axis that goes the right way shows none."""

LOOKS_AT_GROOVE: Final = 3
"""Profiles taken: in one a fault may hide the groove."""


class Carriage:
    """Brings arm or joint from station to station of a job.

    Parameters
    ----------
    context : ScanContext
        The job of all stations.
    directory : Path
        Of its run.
    carrier : Carrier
        What moves.
    """

    def __init__(self, context: ScanContext, directory: Path, carrier: Carrier) -> None:
        self._context, self._directory, self._carrier = context, directory, carrier
        self._settings = carrier_of_job(context.job)
        self._kinematics = self._settings.kinematics
        jobs = [context.job.job_at_station(name) for name in context.job.station_names]
        self._stops = [job.carrier_values for job in jobs]
        deviations = context.sensor_mount.deviations
        self._arm = clear_path_planner_of_job(jobs[0], deviations).kinematics
        self._left: ArmState | None = None

    def bring_to(self, name: str) -> ScanContext:
        """Bring the carrier to a station; gives the context of the scan from there.

        The start poses that a station lacks are those of sections that the one before scanned.

        Raises
        ------
        CarrierFault, ArmFault
            If the way is not clear, an axis goes the wrong way, or a device fails.
        ScanInterrupted
            If everything was to stop at once.
        """
        try:
            return self._brought_to(self._context.job.station_names.index(name))
        except errors.TjscanError as error:
            if self._context.stop.must_stop_now:
                raise errors.ScanInterrupted from error
            raise

    def _brought_to(self, i: int) -> ScanContext:
        names = self._context.job.station_names
        there = self._context.at_station(names[i])
        before = self._directory / names[max(i - 1, 0)]
        seen = self._read_sections(before) if i else ()
        self._find_arm(before, self._directory / names[i])
        if moves := not self._is_at(self._stops[i]):
            here = self._context.at_station(before.name)
            first_move = i == 1 and not _is_begun(self._directory / names[1])
            with self._cell(here) as cell:  # and the arm is drawn back
                ScannedSurfaceObstacle(cell.clearance, seen if first_move else ())
            if first_move and seen and self._settings.driver != "none":
                if not self._is_at(self._stops[0]):  # a look was interrupted
                    self._move_to(here, self._stops[0])
                self._check_directions(here, seen)
            self._move_to(here, self._stops[i])
        reached = self._carrier.state()
        job = there.job.with_carrier_at(reached)
        if job.station[0].first is None and i:
            starts = start_poses_in_overlap(seen, job.station[0].overlap)
            was = read_scan_job(before / JOB_FILE).carrier_values
            T = inverse_pose(job.T_w_b) @ self._kinematics.T_w_b(was)
            first, second = (_pose_settings(T @ start) for start in starts)
            station = replace(job.station[0], first=first, second=second)
            job = job.model_copy(update={"station": (station,)})
        if moves and (posture := job.station[0].posture) is not None:
            with self._cell(replace(there, job=job), drawn_back=False) as cell:
                T_b_f = job.start_poses[0].T
                self._left = cell.arm.move_joint_to_pose(T_b_f, near=np.array(posture))
        arrived = RunEvent("carrier", f"at {self._kinematics.describe(reached)}")
        return replace(there, job=job, left=self._left, arrived=(arrived,))

    def _is_at(self, values: Array) -> bool:
        return bool(np.abs(values - self._carrier.state()).max() < AT_STOP_TOLERANCE)

    def _find_arm(self, *directories: Path) -> None:
        """Take note of where the last of some scans left the arm."""
        for directory in filter(_is_begun, directories):
            if views := read_recorded_scan(directory, _pass_over).views:
                self._left = ArmState(views[-1].q, views[-1].T_b_f, views[-1].time)

    def _read_sections(self, directory: Path) -> Sections:
        """Finished sections of a station's recording; none if it has none."""
        if not _is_begun(directory):
            return ()
        done = read_recorded_scan(directory, _pass_over)
        return done.reread_sections(groove_reader_of_job(self._context.job))

    @contextmanager
    def _cell(self, here: ScanContext, *, drawn_back: bool = True) -> Iterator[Cell]:
        """The cell where the carrier now is, connected; afterwards the arm is drawn back."""
        job = here.job.with_carrier_at(self._carrier.state())
        with add_file_to_errors(here.job_file):
            cell = replace(here, job=job, left=self._left).make_cell()
        stop = self._context.stop
        with cell, stop.halt_arm_on_stop_now(cell.arm.stop):
            stop.raise_if_stop_now()
            yield cell
            stop.raise_if_stop_now()
            if not drawn_back:
                return
            home = np.array(self._settings.home)
            self._left = cell.arm.move_joint_to_pose(self._arm.forward(home), near=home)

    def _move_to(self, here: ScanContext, goal: Array) -> None:
        """Move the carrier on a way on which the arm, as it stands, keeps clear."""
        stop = self._context.stop
        if self._left is None:
            raise errors.CarrierFault("the arm was not drawn back: where it is, is not known")
        sweep = CarrierSweep(here.job, self._arm, self._left.q)
        for values in sweep.clear_way(self._carrier.state(), goal):
            if stop.ends_after_section:
                raise errors.ScanInterrupted
            with stop.halt_arm_on_stop_now(self._carrier.stop):
                stop.raise_if_stop_now()
                self._carrier.move_to(values)

    def _check_directions(self, here: ScanContext, seen: Sections) -> None:
        """Look at the same groove from two places of every axis that is to move.

        Raises
        ------
        CarrierFault
            Naming the axis that goes the other way, or otherwise than it is described.
        """
        start, T_w_b = self._carrier.state(), self._kinematics.T_w_b
        for i, axis in enumerate(self._kinematics.axes):
            ways = np.array(self._stops)[:, i] - start[i]
            way = float(ways[np.abs(ways).argmax()])
            unit = np.sign(way) * np.eye(len(start))[i]
            step, telling = self._telling_step(start, unit, seen)
            other = start + min(step, abs(way)) * unit
            mirrored = self._seeming_shift(start, other - start, telling[-1])
            if (size := float(np.linalg.norm(mirrored))) < LEAST_TELLING_SHIFT:
                continue
            self._move_to(here, other)
            try:
                section, points = self._look_again(here, T_w_b(start), telling)
                mirrored = self._seeming_shift(start, other - start, section)
                size = float(np.linalg.norm(mirrored))
                shift = transform_points(T_w_b(other), points)
                shift -= transform_points(T_w_b(start), section.points_b)
                share = float(shift[[1, 3]].mean(axis=0) @ mirrored) / size**2
                seems = f"seems to have shifted by {1e3 * share * size:.1f} mm"
            except errors.GrooveNotFound:
                share, seems = np.inf, "was not seen again"
            self._move_to(here, start)
            if abs(share) > MOST_SHARE_OF_MIRRORED:
                raise errors.CarrierFault(
                    f"axis {axis.name!r} of the carrier: its direction is reversed. After "
                    f"{axis.unit.to_file(float(other[i] - start[i])):.3g} {axis.unit.suffix} of it "
                    f"the same groove {seems}; if the axis went the other way, it would by "
                    f"{1e3 * size:.1f} mm. Write direction = {[-x for x in axis.direction]} in "
                    "[carrier], or put its point right"
                )

    def _look_again(
        self, here: ScanContext, T_w_b: Array, sections: Sections
    ) -> tuple[ScannedSection, Array]:
        """The last section, of some scanned at T_w_b, that is got to from here, and its points.

        These are the five points as seen now, in b as it is now.
        """
        with self._cell(here) as cell:
            for section in reversed(sections):
                T_b_f = inverse_pose(self._T_w_b) @ T_w_b @ section.view.T_b_f
                try:
                    state = cell.arm.move_joint_to_pose(T_b_f, near=section.view.q)
                    break
                except errors.PoseUnreachable:
                    if section is sections[0]:
                        raise
            profiles = [cell.laser.capture() for _ in range(LOOKS_AT_GROOVE)]
        read, lost = groove_reader_of_job(here.job), errors.GrooveNotFound("not seen", "no look")
        for profile in profiles:
            try:
                T_b_s = state.T_b_f @ cell.T_f_s
                return section, transform_points(T_b_s, read(profile).points_s)
            except errors.GrooveNotFound as error:
                lost = error
        raise lost

    @property
    def _T_w_b(self) -> Array:
        return self._kinematics.T_w_b(self._carrier.state())

    def _telling_step(self, start: Array, unit: Array, seen: Sections) -> tuple[float, Sections]:
        """Step of an axis, and sections that would seem to shift enough if it were reversed."""
        small = DIRECTION_STEP * unit
        sizes = [float(np.linalg.norm(self._seeming_shift(start, small, one))) for one in seen]
        least = TELLING_SHARE * max(sizes)
        telling = [one for one, size in zip(seen, sizes, strict=True) if size >= least]
        step = DIRECTION_STEP * TELLING_SHIFT / max(*sizes, 1e-9)
        return min(step, LONGEST_TELLING_STEP), telling

    def _seeming_shift(self, start: Array, way: Array, section: ScannedSection) -> Array:
        """Shift across the groove, in w, that a section shows if the carrier went the other way."""
        T_w_b = self._kinematics.T_w_b
        T_w_g = T_w_b(start) @ section.T_b_g
        moved = T_w_b(start + way) @ inverse_pose(T_w_b(start - way)) @ T_w_g
        shift, along = moved[:3, 3] - T_w_g[:3, 3], unit_vector(T_w_g[:3, 0])
        return np.asarray(shift - (shift @ along) * along)


@contextmanager
def carriage_of_job(
    context: ScanContext, directory: Path, ask: Callable[[str], bool]
) -> Iterator[Carriage | None]:
    """Connect a job's carrier while the block runs; nothing if it has none.

    Parameters
    ----------
    context : ScanContext
        The job of all stations.
    directory : Path
        Of its run: a simulated carrier is where that left it.
    ask : callable
        Asks a person to move a carrier without a driver, and returns whether it is done.
    """
    job = context.job
    if job.carrier is None:
        yield None
        return
    begun = [name for name in job.station_names if _is_begun(directory / name)]
    for name in begun:
        before = read_scan_job(file := directory / name / JOB_FILE).carrier
        if before is None or replace(before, drivers=job.carrier.drivers) != job.carrier:
            raise errors.ConfigurationError(
                f"is not as in {file}: what was scanned there would not fit. Start a new scan",
                file=context.job_file,
                key="carrier",
            )
    last = context.at_station(begun[-1] if begun else job.station_names[0]).job.carrier_values
    with job.carrier.make_device(CarrierDriverInputs(job.carrier.kinematics, last, ask)) as carrier:
        yield Carriage(context, directory, carrier)


def start_poses_in_overlap(sections: Sections, overlap: float) -> tuple[Array, Array]:
    """Flange poses of two neighbouring sections from which a scan overlaps an earlier one.

    Parameters
    ----------
    sections : sequence of ScannedSection
        Of the earlier scan, in its order.
    overlap : float
        From the first of the two to the last section, metres.

    Returns
    -------
    first, second : ndarray, shape (4, 4)
        In the earlier scan's frame b.

    Raises
    ------
    CarrierFault
        If there are fewer than two sections.
    """
    if len(sections) < 2:
        raise errors.CarrierFault(
            "the station before has no two sections from which the next one could start: scan it "
            "first, or state start poses"
        )
    places = np.array([section.T_b_g[:3, 3] for section in sections])
    gone = np.concatenate(([0.0], np.linalg.norm(np.diff(places, axis=0), axis=1).cumsum()))
    i = int(np.abs(gone[-1] - gone[:-1] - overlap).argmin())
    return sections[i].view.T_b_f, sections[i + 1].view.T_b_f


def _pass_over(damage: RecordingDamage) -> None:
    """A scan that is gone on with reports it."""


def _is_begun(directory: Path) -> bool:
    return (directory / JOB_FILE).is_file() and not nothing_recorded_yet(directory)


def _pose_settings(T: Array) -> PoseSettings:
    position, angles = pose_to_euler_zyx(T)
    x, y, z = position.tolist()
    a, b, c = angles.tolist()
    return PoseSettings(position=(x, y, z), euler_zyx=(a, b, c))
