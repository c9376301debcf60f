"""The acceptance of a cell, from its job to its record; and what drifted since an earlier one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from datetime import UTC, date, datetime
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from pydantic import AwareDatetime, TypeAdapter
from pydantic_core import to_json
from scipy.linalg import block_diag

from tjscan.calibration.targets.target import PosedProfile
from tjscan.calibration.wizard.logbook import CALIBRATION_TOPICS
from tjscan.calibration.wizard.operator import Operator
from tjscan.core.config import table_to_dict
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError, LaserFault
from tjscan.core.files import lock_and_clean_directory, write_files_atomically
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.job.cell import SensorMount, make_cell, motion_limits_of_job, sensor_mount_of_job
from tjscan.job.files import AcceptanceJob
from tjscan.laser.drivers import SimulatedScene
from tjscan.laser.optics import RaycastSurface
from tjscan.recording.journal import RecordingWriter
from tjscan.result.directory import CALIBRATION_FILE, job_label_of_run
from tjscan.robot.arm import ArmState
from tjscan.robot.deviations import deviation_jacobian
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import PlacementTolerance
from tjscan.runs.accept import judge
from tjscan.runs.accept.judge import AcceptanceRow, BallLooks, StatedErrors
from tjscan.runs.accept.measure import RETURN_BESIDE_MIDDLE, ArtefactViewer
from tjscan.runs.calibration.run import ball_mesh
from tjscan.runs.run import make_run_directory, read_result_file

ACCEPTANCE_FILE: Final = "acceptance.json"
ACCEPTANCE_RECORDING: Final = "accept.mcap"

REACTION_TIME: Final = 0.1
"""Seconds after which a stop brakes, where a job states no stopping distance. Assumption."""

POSTURES_OF_RMS: Final = 100
"""Drawn postures over which an arm's stated error is the root mean square."""

LARGEST_RADIUS_GAP: Final = 1e-3
"""Metres between the certified radius and the one that places the ball."""

LOOKS_AT_SECOND: Final = 3
"""On either side of the second ball of a bar."""


@dataclass(frozen=True, slots=True)
class Acceptance:
    """The record of an acceptance.

    Parameters
    ----------
    program, job : str
        What wrote it, from which job.
    date : datetime
        When it began, UTC.
    arm, laser : str
        Their ids, as calibrations have them.
    devices : dict of str to str
        What arm and laser say of themselves.
    artefact : dict of str to object
        The table [artefact].
    rows : tuple of AcceptanceRow
        What was measured.
    against : str
        The earlier one that drifts count from: its date.
    """

    program: str
    job: str
    date: AwareDatetime
    arm: str
    laser: str
    devices: dict[str, str]
    artefact: dict[str, Any]
    rows: tuple[AcceptanceRow, ...]
    against: str = ""

    @property
    def passes(self) -> bool:
        """Whether every row does, and none has drifted."""
        return all(row.passes and not row.has_drifted for row in self.rows)

    def compared_with(self, earlier: Acceptance) -> Acceptance:
        """The same with drifts of what both measured; an artefact certified again was away."""
        stayed = self.artefact["certificate"] == earlier.artefact.get("certificate")
        before = {row.key: row for row in earlier.rows if stayed or row.limit is not None}
        rows = [
            row.compared_with(before[row.key]) if row.key in before else row for row in self.rows
        ]
        return replace(self, rows=tuple(rows), against=f"{earlier.date:%Y-%m-%d %H:%M} UTC")


def check_certificate(job: AcceptanceJob, today: date) -> None:
    """Refuse a certificate that does not hold today.

    Raises
    ------
    ConfigurationError
        Naming its key.
    """
    table = job.artefact
    if table.date > today:
        reason = f"the certificate is of {table.date}, which is in the future (today: {today})"
        raise ConfigurationError(reason, key="artefact.date")
    if table.valid_until < today:
        reason = f"the certificate expired on {table.valid_until}: have the artefact measured again"
        raise ConfigurationError(reason, key="artefact.valid_until")


def read_earlier_acceptance(directory: Path, job: AcceptanceJob) -> Acceptance:
    """Read an earlier acceptance of a job's cell: its file, its run, or the first that passed.

    Raises
    ------
    ConfigurationError
        If there is none of this arm and laser, none of several passed, or it can't be read.
    """
    files = [directory, directory / ACCEPTANCE_FILE, *directory.glob(f"*/{ACCEPTANCE_FILE}")]
    parse = TypeAdapter(Acceptance).validate_json
    found = [read_result_file(file, "an acceptance", parse) for file in files if file.is_file()]
    own = [one for one in found if (one.arm, one.laser) == _device_ids(job)]
    if not own:
        arm, laser = _device_ids(job)
        raise ConfigurationError(
            f"holds no acceptance of arm {arm!r} with laser {laser!r}"
            + "".join(f"; there is one of {one.arm!r} with {one.laser!r}" for one in found[:3]),
            file=directory,
        )
    passed = [one for one in own if one.passes] or own[: len(own) == 1]
    if not passed:
        raise ConfigurationError("none of its acceptances passed: name one of them", file=directory)
    return min(passed, key=lambda one: one.date)


def _device_ids(job: AcceptanceJob) -> tuple[str, str]:
    return job.arm.device_id, job.laser.device_id


def accept_cell(
    job: AcceptanceJob,
    job_file: Path,
    directory: Path,
    operator: Operator,
    earlier: Acceptance | None = None,
) -> Acceptance:
    """Take a cell through its artefact, and write what was measured into a new directory.

    Parameters
    ----------
    job : AcceptanceJob
        The job, of one station if it has any.
    job_file : Path
        The file that it was read from.
    directory : Path
        To make.
    operator : Operator
        Is asked before every move.
    earlier : Acceptance, optional
        That drifts count from.

    Raises
    ------
    TjscanError
        If the job is wrong, a device fails or the ball is not seen.
    """
    began = datetime.now(UTC).replace(microsecond=0)
    check_certificate(job, began.date())
    kinds, mount = {job.arm.driver_kind, job.laser.driver_kind}, sensor_mount_of_job(job, job_file)
    if DriverKind.REPLAYED in kinds:
        raise ConfigurationError("an acceptance moves the arm: nothing replayed", key="arm.driver")
    if not operator.present and kinds != {DriverKind.SIMULATED}:
        raise ConfigurationError("a real arm moves only while a person watches: not unattended")
    if abs(job.ball.radius - job.artefact.radius) > LARGEST_RADIUS_GAP:
        reason = f"is {1e3 * (job.artefact.radius - job.ball.radius):+.1f} mm beside ball.radius_mm"
        raise ConfigurationError(f"{reason}: a diameter?", key="artefact.radius_mm")
    if mount.covariance is None:
        raise ConfigurationError(
            "an acceptance holds the calibration against its certainty, which is not stated: name "
            "a calibration's file, or sigma_position_mm and sigma_rotation_deg",
            key="calibration",
        )
    make_run_directory(directory, job, job_file, {CALIBRATION_FILE: mount.file})
    cell = make_cell(job, mount, lambda: _scene_of_job(job))
    stated = _errors_of_job(job, mount, cell.clearance.kinematics)
    recording = RecordingWriter(directory / ACCEPTANCE_RECORDING, CALIBRATION_TOPICS)
    with lock_and_clean_directory(directory), recording, cell:
        viewer = ArtefactViewer(cell, stated, job.artefact.radius, operator, recording)
        measured = Measured.take(job, viewer)
        devices = {"arm": str(cell.arm.identity), "laser": str(cell.laser.identity)}
    head = Provenance.for_file_written_now(job_label_of_run(directory), "b")
    what = table_to_dict(job.artefact), tuple(measured.rows(job, stated))
    found = Acceptance(head.program, head.job, began, *_device_ids(job), devices, *what)
    found = found if earlier is None else found.compared_with(earlier)
    with write_files_atomically(directory, listed=True) as draft:
        told = [asdict(row) | {"passes": row.passes} for row in found.rows]
        record = asdict(found) | {"passes": found.passes, "rows": told}
        (draft / ACCEPTANCE_FILE).write_bytes(to_json(record, indent=2))
    return found


def _scene_of_job(job: AcceptanceJob) -> SimulatedScene:
    """The ball where it truly is, and the second one of a bar beside it as stated."""
    ball = (job.simulation and job.simulation.ball) or job.ball
    meshes = [ball_mesh(ball.radius, ball.position)]
    if job.artefact.second is not None:
        meshes.append(ball_mesh(ball.radius, ball.position + _beside(job)))
    whole = trimesh.util.concatenate(meshes)
    return SimulatedScene(RaycastSurface(whole.vertices, whole.faces), np.eye(4))


def _errors_of_job(job: AcceptanceJob, mount: SensorMount, kinematics: Kinematics) -> StatedErrors:
    covariance, uncertainty = np.asarray(mount.covariance), job.laser.uncertainty
    if mount.deviations is None:
        sigmas = _joint_sigmas(kinematics, job.arm.uncertainty.absolute)
        covariance = block_diag(covariance, np.diag(sigmas**2))
    repeats, _ = job.arm.uncertainty.stated_repeatability
    each_axis = np.maximum(np.array((repeats.position, repeats.angle)) / np.sqrt(3), 1e-9)
    noise = replace(job.ball.noise, position=float(each_axis[0]), rotation=float(each_axis[1]))
    window = job.laser_model.measuring_range
    linearity, bias = uncertainty.stated_linearity[0], uncertainty.stated_bias[0]
    return StatedErrors(kinematics, mount.T_f_s, covariance, noise, window, linearity, bias)


def _joint_sigmas(kinematics: Kinematics, absolute: float | None) -> Array:
    """Of the joints' deviations, shape (6 joints,), with which the flange errs as is stated."""
    joints = len(kinematics.lower)
    sigmas = np.tile(PlacementTolerance().sigmas, joints)
    if absolute is None:
        return sigmas
    drawn = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSTURES_OF_RMS, joints))
    moved = [deviation_jacobian(kinematics, q).reshape(6, -1)[:3] * sigmas for q in drawn]
    return np.asarray(sigmas * absolute / np.sqrt(np.mean(np.sum(np.square(moved), axis=(1, 2)))))


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What an acceptance measured."""

    grid: BallLooks
    returns: list[PosedProfile]
    postures: list[PosedProfile]
    second: list[PosedProfile]
    stop: tuple[list[ArmState], int]
    clocks: list[tuple[float, float, float]]
    clock_fault: LaserFault | None

    @classmethod
    def take(cls, job: AcceptanceJob, viewer: ArtefactViewer) -> Measured:
        """Find the ball, and measure everything at it."""
        settings, R, stated = job.accept, viewer.radius, viewer.stated
        centre = np.array(job.ball.position)
        turn = viewer.steepest_view(centre)
        first = viewer.flange_poses(turn, centre, islice(viewer.window_places(), 2))
        viewer.begin(first[0])
        seen = [viewer.look_from_each("first look", first)]
        centre = BallLooks.of_profiles(seen, stated, np.append(centre, R), 2).solved().target[:3]
        moved = centre - job.ball.position
        views = viewer.plan_views(centre, settings.postures)
        places = list(viewer.window_places())
        poses = viewer.flange_poses(turn, centre, places)
        aside = np.array((0.0, RETURN_BESIDE_MIDDLE * R, places[0][2]))
        (for_returns,) = viewer.flange_poses(turn, centre, [aside])

        viewer.look("the middle", poses[0])
        clocks = viewer.lay_clock(motion_limits_of_job(job))
        stop = viewer.stop_on_the_way(poses[0])
        returns = viewer.return_to(for_returns, settings.returns)
        grid = viewer.look_from_each("window", poses)
        second = []
        if job.artefact.second is not None:
            there = viewer.flange_poses(turn, np.add(job.artefact.second, moved), places[:2])
            second = viewer.look_from_each("second ball", there * LOOKS_AT_SECOND)
            viewer.begin(poses[0])
        postures = viewer.look_from_postures(views, settings.postures)
        viewer.begin(poses[0])
        viewer.look("the middle", poses[0])
        clocks += viewer.lay_clock(motion_limits_of_job(job))
        start = np.append(centre, R)
        looks = BallLooks.of_profiles([grid], stated, start, judge.FEWEST_LOOKS).solved()
        return cls(looks, returns, postures, second, stop, clocks, viewer.clock_fault)

    def rows(self, job: AcceptanceJob, stated: StatedErrors) -> Iterator[AcceptanceRow]:
        """What was measured, against what is stated."""
        yield from self._rows_of_motion(job)
        least, target = judge.FEWEST_LOOKS, self.grid.target
        returns = BallLooks.of_profiles([self.returns], stated, target, least)
        _, evidence = job.arm.uncertainty.stated_repeatability
        what = f"pose repeatability RP, n = {returns.count} (ISO 9283)"
        source = f"arm.uncertainty.repeatability_mm ({evidence}) and the laser's noise"
        numbers = returns.repeatability()
        row = AcceptanceRow.of_length("repeatability", what, numbers, source)
        if self.clock_fault is not None and row.passes:
            raise self.clock_fault
        yield row
        times = max(1.0, numbers[0] / numbers[2])
        noise = stated.noise
        noise = replace(noise, position=times * noise.position, rotation=times * noise.rotation)
        stated = replace(stated, noise=noise)
        limit, evidence = job.laser.uncertainty.stated_linearity
        found, sigma = self.grid.solved(stated).linearity()
        what = "largest deviation of the laser in its window"
        source = f"laser.uncertainty.linearity_mm ({evidence})"
        yield AcceptanceRow.of_length("linearity", what, (found, sigma, limit), source)
        # What was found of the laser and of returns is no fault of what follows.
        stated = replace(stated, linearity=max(found, limit))
        points = (*self.grid.noise(), job.ball.noise.range)
        yield AcceptanceRow.of_length(
            "noise", "noise of a point in range", points, "ball.noise.range_mm"
        )
        yield from self._rows_of_artefact(job, stated)

    def _rows_of_motion(self, job: AcceptanceJob) -> Iterator[AcceptanceRow]:
        states, ordered = self.stop
        if states:
            found, sigma, speed = judge.stopping(states, ordered)
            limit, source = job.accept.stopping, "accept.stopping_mm"
            if limit is None:
                limit = speed**2 / (2 * job.arm.acceleration) + REACTION_TIME * speed
                source = f"arm.acceleration_mm_s2, and {REACTION_TIME:g} s until it brakes"
            what = f"stopping distance from {1e3 * speed:.0f} mm/s"
            yield AcceptanceRow.of_length("stopping", what, (found, sigma, limit), source)
        if len(self.clocks) > 1:
            drift, sigma = judge.clock_drift(self.clocks[0], self.clocks[-1])
            span = self.clocks[-1][0] - self.clocks[0][0]
            what = f"drift of the laser's clock against the arm's, in {span:.0f} s"
            of = 1e6 * drift, 1e6 * sigma, 1e6 * job.accept.clock_drift, "accept.clock_drift_ppm"
            yield AcceptanceRow("clock", what, "ppm", *of)

    def _rows_of_artefact(
        self, job: AcceptanceJob, stated: StatedErrors
    ) -> Iterator[AcceptanceRow]:
        table, least, grid = job.artefact, judge.FEWEST_LOOKS, self.grid.solved(stated)
        looks = BallLooks.of_profiles([self.postures], stated, grid.target, least).solved()
        what = f"scatter of the ball's centre from {looks.count} postures, RMS"
        source = "calibration, arm.uncertainty, laser.uncertainty"
        yield AcceptanceRow.of_length("calibration", what, looks.scatter(), source)
        found, sigma = float(grid.target[3]), float(np.sqrt(grid.estimate()[1][3, 3]))
        of = f"certificate {table.certificate}"
        numbers = found, sigma, table.radius_expanded
        yield AcceptanceRow.of_length("radius", "radius of the ball", numbers, of, table.radius)
        if table.distance is not None and table.distance_expanded is not None:
            both = [self.grid.profiles[0], self.second]
            start = np.append(grid.target, (*np.add(grid.target[:3], _beside(job)), table.radius))
            bar = BallLooks.of_profiles(both, stated, start, 2).solved()
            numbers = (*bar.distance(), table.distance_expanded)
            yield AcceptanceRow.of_length(
                "distance", "distance of the balls", numbers, of, table.distance
            )
        if table.fixed:
            sigmas = looks.centre_sigmas()
            for axis, at, sigma in zip("xyz", looks.target, sigmas, strict=False):
                what = f"{axis} of the ball's centre in b"
                yield AcceptanceRow.of_length(
                    f"place {axis}", what, (float(at), float(sigma), None), ""
                )


def _beside(job: AcceptanceJob) -> Array:
    """From the ball to the second one of a bar, about, shape (3,), metres."""
    return np.subtract(job.artefact.second or job.ball.position, job.ball.position)
