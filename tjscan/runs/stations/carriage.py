"""From station to station by a carrier.

The arm is drawn back before, the carrier's way is looked at, and its axes go the way they should.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
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
from tjscan.job.carrier import CarrierSweep, carrier_of_job, check_at_station, is_at_stop
from tjscan.job.cell import Cell, clear_path_planner_of_job
from tjscan.job.files import read_scan_job
from tjscan.recording.journal import RunEvent
from tjscan.result.directory import JOB_FILE
from tjscan.robot.arm import ArmState
from tjscan.runs.run import nothing_recorded_yet
from tjscan.runs.scan.run import ScanContext, groove_reader_of_job
from tjscan.scanning.journal import RecordedScan, ScannedSurfaceObstacle
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import ScannedSection, Sections

DIRECTION_STEP: Final = 1e-3
"""Metres and radians of an axis, for its derivative."""

TELLING_SHIFT: Final = 8e-3
"""Metres across the groove by which it would seem to shift if an axis went the other way: far more
than a carrier is off at a stop, and well within a laser's window."""

TELLING_SHARE: Final = 0.5
"""Of the largest shift that any section would show."""

LEAST_TELLING_SHIFT: Final = 2e-3
"""Metres: a smaller one shows nothing, and the axis is not looked at."""

LEAST_SHARE_ACROSS: Final = 0.2
"""Of a section's motion: where it moves along the groove, the laser sees other parts of it, which
were not scanned, and the shift shows how the groove bends there."""

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
        names = self._context.job.station_names
        i, there = names.index(name), self._context.at_station(name)
        before = self._directory / names[max(i - 1, 0)]
        done, begun = _recorded(before), _recorded(self._directory / name)
        for recorded in (done, begun):
            if recorded is not None and recorded.views:
                last = recorded.views[-1]
                self._left = ArmState(last.q, last.T_b_f, last.time)
        seen = done.reread_sections(groove_reader_of_job(there.job)) if i and done else ()
        if moves := not self._is_at(self._stops[i]):
            here = self._context.at_station(before.name)
            if self._settings.driver != "none" and not self._has_moved():
                if not seen:
                    check_at_station(there.job, self._carrier.state())
                self._check_directions(here, seen)
            with self._cell(here, seen) as cell:  # draws the arm back
                home = np.array(self._settings.home)
                cell.arm.move_joint_to_pose(self._arm.forward(home), near=home)
            self._move_to(here, self._stops[i])
        reached = self._carrier.state()
        job = there.job.with_carrier_at(reached)
        if job.station[0].first is None and i:
            starts = start_poses_in_overlap(seen, job.station[0].overlap)
            T = inverse_pose(job.T_w_b) @ read_scan_job(before / JOB_FILE).T_w_b
            first, second = (_pose_settings(T @ start) for start in starts)
            station = replace(job.station[0], first=first, second=second)
            job = job.model_copy(update={"station": (station,)})
        if moves and (posture := job.station[0].posture) is not None:
            with self._cell(replace(there, job=job)) as cell:
                cell.arm.move_joint_to_pose(job.start_poses[0].T, near=np.array(posture))
        arrived = RunEvent("carrier", f"at {self._kinematics.describe(reached)}")
        return replace(there, job=job, left=self._left, arrived=(arrived,))

    def _has_moved(self) -> bool:
        """Whether scans have begun at two stops, so that the axes were looked at between them."""
        begun = [_is_begun(self._directory / name) for name in self._context.job.station_names]
        stops = np.array(self._stops)[begun]
        return any(not is_at_stop(stop, stops[0]) for stop in stops)

    def _is_at(self, values: Array) -> bool:
        return is_at_stop(self._carrier.state(), values)

    @contextmanager
    def _cell(self, here: ScanContext, seen: Sections = ()) -> Iterator[Cell]:
        """The cell where the carrier now is, connected; how it leaves the arm is noted.

        Of sections seen from here, the arm keeps clear of the groove between them.
        """
        at = here.job.carrier_values
        job = here.job.with_carrier_at(self._carrier.state())
        with add_file_to_errors(here.job_file):
            cell = replace(here, job=job, left=self._left).make_cell()
        ScannedSurfaceObstacle(cell.clearance, seen if self._is_at(at) else ())
        stop = self._context.stop
        with cell, stop.halt_arm_on_stop_now(cell.arm.stop):
            if stop.ends_after_section:
                raise errors.ScanInterrupted
            yield cell
            stop.raise_if_stop_now()
            self._left = cell.arm.state()

    def _move_to(self, here: ScanContext, goal: Array) -> None:
        """Move the carrier on a way on which the arm, as it now stands, keeps clear."""
        with self._cell(here) as cell:
            q = cell.arm.state().q
        for values in CarrierSweep(here.job, self._arm, q).clear_way(self._carrier.state(), goal):
            self._drive(values)

    def _drive(self, values: Array) -> None:
        stop = self._context.stop
        with stop.halt_arm_on_stop_now(self._carrier.stop):
            if stop.ends_after_section:
                raise errors.ScanInterrupted
            self._carrier.move_to(values)

    def _check_directions(self, here: ScanContext, seen: Sections) -> None:
        """Look at the same groove from two places of every axis that is to move.

        The arm stands before a section that was scanned, and only the carrier moves.

        Raises
        ------
        CarrierFault
            Naming the axis that goes the other way, or otherwise than it is described.
        """
        if not self._is_at(stop := here.job.carrier_values):  # a look, or the move, was cut off
            self._move_to(here, stop)
        start, T_w_b = self._carrier.state(), self._kinematics.T_w_b
        for i, axis in enumerate(self._kinematics.axes):
            ways = np.array(self._stops)[:, i] - start[i]
            way = float(ways[np.abs(ways).argmax()]) * np.eye(len(start))[i]
            other, telling = self._telling_step(start, way, seen)
            if not telling:
                continue
            ends = other, 2 * start - other
            mirrored = self._stand_before(telling, here, seen, ends, axis.name)
            self._drive(other)
            off = self._look(here, inverse_pose(T_w_b(start)) @ T_w_b(other), seen)
            self._drive(start)
            step = f"{axis.unit.to_file(float(other[i] - start[i])):.3g} {axis.unit.suffix} of it"
            if off == np.inf:
                raise errors.CarrierFault(
                    f"axis {axis.name!r} of the carrier: the groove was not seen after {step}; "
                    "nothing is known of the axis' direction"
                )
            if off > MOST_SHARE_OF_MIRRORED * mirrored:
                raise errors.CarrierFault(
                    f"axis {axis.name!r} of the carrier: its direction is reversed. After {step} "
                    f"the groove is {1e3 * off:.1f} mm beside where it was scanned; if the axis "
                    f"went the other way, it would be {1e3 * mirrored:.1f} mm beside. Write "
                    f"direction = {[-x or 0.0 for x in axis.direction]} in [carrier], or put its "
                    "point right"
                )

    def _stand_before(
        self,
        telling: list[tuple[ScannedSection, float]],
        here: ScanContext,
        seen: Sections,
        ends: tuple[Array, Array],
        axis: str,
    ) -> float:
        """Bring the arm to the last of some sections where the carrier may move to either end.

        Gives what the section would seem to shift if the axis were reversed.
        """
        blocked = []
        for section, mirrored in reversed(telling):
            view = section.view
            try:
                for end in ends:
                    CarrierSweep(here.job, self._arm, view.q).check_line(self._carrier.state(), end)
                with self._cell(here, seen) as cell:
                    cell.arm.move_joint_to_pose(view.T_b_f, near=view.q)
            except (errors.CarrierFault, errors.PoseUnreachable) as error:
                blocked.append(str(error).partition(". ")[0])  # without advice for other ways
            else:
                return mirrored
        raise errors.CarrierFault(
            f"the look at axis {axis!r} (and if it went the other way): {blocked[0]}"
        )

    def _look(self, here: ScanContext, T_b_b: Array, seen: Sections) -> float:
        """Metres by which the groove, put back by T_b_b, is beside what was seen; else infinite."""
        with self._cell(here) as cell:
            T_b_s = T_b_b @ cell.arm.state().T_b_f @ cell.T_f_s
            profiles = [cell.laser.capture() for _ in range(LOOKS_AT_GROOVE)]
        read = groove_reader_of_job(here.job)
        for profile in profiles:
            with suppress(errors.GrooveNotFound):
                points_b = transform_points(T_b_s, read(profile).points_s)
                return _shift_across(_middle(points_b), *_middles_and_directions(seen))
        return np.inf

    def _telling_step(
        self, start: Array, way: Array, seen: Sections
    ) -> tuple[Array, list[tuple[ScannedSection, float]]]:
        """A step of an axis, and sections that would seem to shift enough if it were reversed.

        With each section, by how much it would, metres across the groove.
        """
        unit = np.sign(way)
        most = self._seeming_shifts(start, start + DIRECTION_STEP * unit, seen)[0].max()
        step = min(DIRECTION_STEP * TELLING_SHIFT / max(most, 1e-9), LONGEST_TELLING_STEP)
        other = start + np.clip(step * unit, -np.abs(way), np.abs(way))
        shifts, motions = self._seeming_shifts(start, other, seen)
        least = max(LEAST_TELLING_SHIFT, TELLING_SHARE * shifts.max())
        least = np.maximum(least, LEAST_SHARE_ACROSS * motions)
        pairs = zip(seen, shifts.tolist(), shifts >= least, strict=True)
        return other, [(section, shift) for section, shift, tells in pairs if tells]

    def _seeming_shifts(self, start: Array, other: Array, seen: Sections) -> tuple[Array, Array]:
        """How far sections seem to shift across the groove, and move, if an axis is reversed.

        Both in metres, shape (n,).
        """
        T_w_b = self._kinematics.T_w_b
        T_b_mirrored = inverse_pose(T_w_b(2 * start - other)) @ T_w_b(start)
        T_b_b = inverse_pose(T_w_b(start)) @ T_w_b(other) @ T_b_mirrored
        middles, along = _middles_and_directions(seen)
        moved = transform_points(T_b_b, middles)
        shifts = np.array([_shift_across(middle, middles, along) for middle in moved])
        return shifts, np.linalg.norm(moved - middles, axis=1)


def _middle(points: Array) -> Array:
    """Of a section's points, shape (5, 3), the middle between the edges."""
    return np.asarray(points[[1, 3]].mean(axis=0))


def _middles_and_directions(seen: Sections) -> tuple[Array, Array]:
    """Middle of each section, and the groove's direction there, in b, both of shape (n, 3)."""
    middles = np.array([_middle(one.points_b) for one in seen])
    return middles, np.array([unit_vector(one.T_b_g[:3, 0]) for one in seen])


def _shift_across(middle: Array, middles: Array, directions: Array) -> float:
    """Metres by which a section's middle is beside the groove where it was scanned."""
    shifts = middle - middles
    i = int(np.linalg.norm(shifts, axis=1).argmin())
    return float(np.linalg.norm(shifts[i] - (shifts[i] @ directions[i]) * directions[i]))


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


def _recorded(directory: Path) -> RecordedScan | None:
    """A station's scan as recorded; a scan that is gone on with reports what is damaged."""
    if not _is_begun(directory):
        return None
    return read_recorded_scan(directory, lambda damage: None)


def _is_begun(directory: Path) -> bool:
    return (directory / JOB_FILE).is_file() and not nothing_recorded_yet(directory)


def _pose_settings(T: Array) -> PoseSettings:
    position, angles = pose_to_euler_zyx(T)
    x, y, z = position.tolist()
    a, b, c = angles.tolist()
    return PoseSettings(position=(x, y, z), euler_zyx=(a, b, c))
