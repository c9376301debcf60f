"""Laws of the continuous scan on the example's cell."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from cells import CLOCKWISE, EXAMPLES, PAPER, Notes, example_corner_errors
from continuous_scans import SHORT, HeardThrough, flange_speeds, passing_views, scan_continuously
from scipy.interpolate import make_interp_spline

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core.errors import ArmFault, ConfigurationError, LaserFault
from tjscan.core.frames import JointOrBaseFrame, transform_points
from tjscan.job.cell import motion_limits_of_job
from tjscan.job.files import read_scan_job
from tjscan.joint.edges import feature_edges
from tjscan.laser.line_laser import StreamedProfile
from tjscan.laser.profile import Profile
from tjscan.recording.journal import RunEvent
from tjscan.result.section import absent_corners
from tjscan.robot.following import JointMotion
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.simulated_following import CONTROLLER_TICK, SimulatedFollowing
from tjscan.runs.scan.run import ScanContext
from tjscan.scanning.continuous import path_ahead
from tjscan.scanning.continuous.smoothing import finished_sections, smooth_corners
from tjscan.scanning.journal import ScanEvent, StopReason
from tjscan.scanning.section import ProfileView, ScannedSection, Substep
from tjscan.scanning.sections_before import TACK_END_LENGTH
from tjscan.scanning.stopping import StopRequest

YARD = EXAMPLES / "yard-joint.toml"

AT_REST = 2e-3
"""Metres per second: slower is at rest."""


@pytest.mark.parametrize("file", [PAPER, CLOCKWISE], ids=["ccw", "cw"])
def test_the_groove_is_followed_without_a_stop_and_measured_every_2_mm(file: object) -> None:
    notes = Notes()
    exact = dict.fromkeys(
        ("simulation.arm.repeatability_mm", "simulation.arm.repeatability_deg"), 0
    )
    result = scan_continuously(exact, file=file, notes=notes)  # type: ignore[arg-type]
    assert result.stop is StopReason.LENGTH
    assert result.counts.stepwise == 0
    measured = result.sections[1:]
    steps = np.linalg.norm(np.diff([s.T_b_g[:3, 3] for s in measured], axis=0), axis=1)
    assert abs(steps.mean() - 2e-3) < 0.1e-3
    errors = 1e3 * example_corner_errors(replace(result, sections=tuple(measured)), file)  # type: ignore[arg-type]
    assert errors.mean() <= 0.03
    assert np.percentile(errors, 95) <= 0.05
    speeds = flange_speeds(passing_views(notes))
    moving = np.flatnonzero(speeds > AT_REST)
    assert (speeds[moving[0] : moving[-1]] > AT_REST).all()


@pytest.mark.parametrize(
    "keys",
    [{}, {"scan.speed_mm_s": 300.0}, {"arm.acceleration_mm_s2": 100.0}],
    ids=["usual", "fast", "gentle"],
)
def test_no_set_point_of_the_arm_is_over_a_limit(
    keys: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Finite differences of all motions at the controller's tick, over all new paths."""
    replace_motion, motions = SimulatedFollowing.replace, {}

    def watched(following: SimulatedFollowing, motion: JointMotion) -> None:
        replace_motion(following, motion)
        motions[following] = following._motion

    monkeypatch.setattr(SimulatedFollowing, "replace", watched)
    monkeypatch.setattr(path_ahead, "MOST_TIMES_AS_FAST", 5.0)
    scan_continuously(keys | {"scan.length_mm": 250.0})
    arm = Kinematics.load("ur10e")
    limits = motion_limits_of_job(read_scan_job(PAPER, SHORT | keys))
    for motion in motions.values():
        q, _ = motion.at(np.arange(motion.times[0], motion.end, CONTROLLER_TICK))
        points = np.array([arm.forward(one)[:3, 3] for one in q])
        speed, moved = (np.diff(v, axis=0) / CONTROLLER_TICK for v in (q, points))
        quick, pushed = (np.diff(v, axis=0) / CONTROLLER_TICK for v in (speed, moved))
        assert (np.abs(speed) <= 1.02 * limits.joint_speed * arm.velocity).all()
        assert np.abs(quick).max() <= 1.02 * limits.joint_acceleration
        assert np.linalg.norm(moved, axis=1).max() <= 1.02 * limits.tcp_speed
        assert np.linalg.norm(pushed, axis=1).max() <= 1.02 * limits.tcp_acceleration


def test_a_tack_is_named_from_end_to_end_and_no_corner_is_wrong_beside_it() -> None:
    job = read_scan_job(YARD)
    joint = ScanContext(job, YARD).joint
    assert joint is not None
    assert job.joint is not None
    result = scan_continuously({"scan.length_mm": 160.0, "simulation.seed": 34}, file=YARD)
    sections = finished_sections(result.sections)
    edges, T_j_b = feature_edges(joint), JointOrBaseFrame(job.joint.T_w_j).T_r_b
    corners = np.array([transform_points(T_j_b, section.points_b) for section in sections])
    covered = edges.on_tack(corners[:, 2]) | edges.on_tack(corners[:, 3])
    named = np.array([section.groove.on_tack for section in sections])
    assert covered.sum() > 10
    assert named[covered].all()
    roots = make_interp_spline(range(len(corners)), corners[:, 2:4], k=1)
    fine = roots(np.arange(0.0, len(corners) - 1.0, 0.05))
    tack = fine[edges.on_tack(fine[:, 0]) | edges.on_tack(fine[:, 1])]
    away = np.linalg.norm(corners[:, None, 2] - tack[:, 0], axis=2).min(axis=1)
    assert away[named].max() < TACK_END_LENGTH + 0.2e-3
    grooves = [section.groove for section in sections]
    off = corner_to_edge_distances(corners, edges, absent_corners(grooves))[~named]
    assert np.nanmax(off) < 0.5e-3
    smooth = smooth_corners(sections)[~named]
    corners[~named, 1:4] = transform_points(T_j_b, smooth.reshape(-1, 3)).reshape(smooth.shape)
    assert np.nanmax(corner_to_edge_distances(corners, edges)[~named]) < 0.5e-3


def test_every_profile_is_recorded_before_its_section() -> None:
    notes = Notes()
    result = scan_continuously({}, notes=notes)
    fused = {v.index: v for v in notes.views if v.substep is Substep.FUSED}
    for section in result.sections[1:]:
        assert fused[section.view.index] is section.view
    times = np.array([view.time for view in passing_views(notes)])
    assert np.median(np.diff(times)) == pytest.approx(5e-3, rel=1e-3)
    assert (np.diff(times) > 0).all()


def test_a_silent_laser_brings_the_arm_to_rest_on_the_path_and_it_goes_on() -> None:
    notes = Notes()
    silent = HeardThrough(lambda n, profile: None if 300 <= n < 740 else profile)
    result = scan_continuously({}, notes=notes, through=silent)
    assert result.stop is StopReason.LENGTH
    steps = np.linalg.norm(np.diff([s.T_b_g[:3, 3] for s in result.sections], axis=0), axis=1)
    assert steps.max() < 4.5e-3  # it returned to where it had read last
    assert example_corner_errors(result)[1:].max() < 0.4e-3


def test_a_laser_that_stays_silent_is_a_fault_of_the_laser() -> None:
    dead = HeardThrough(lambda n, profile: None if n > 100 else profile)
    with pytest.raises(LaserFault, match="no profile"):
        scan_continuously({}, through=dead)


def test_repeated_profiles_are_not_taken_for_new_ones() -> None:
    kept: list[Profile | None] = []

    def stuck(n: int, profile: Profile | None) -> Profile | None:
        kept.append(profile if not 150 <= n < 200 else kept[149])
        return kept[-1]

    notes = Notes()
    scan_continuously({}, notes=notes, through=HeardThrough(stuck))
    digests = [view.profile.digest for view in passing_views(notes)]
    assert len(set(digests)) == len(digests)


def test_where_the_groove_cannot_be_read_the_scan_steps_over_and_says_so() -> None:
    blank, begun = np.full(640, np.nan), list[float]()

    def blind(n: int, profile: Profile | None) -> Profile | None:
        if profile is None or (not begun and n < 400):
            return profile
        begun.append(profile.time)
        return profile if profile.time > begun[0] + 10.0 else replace(profile, x_s=blank, z_s=blank)

    notes = Notes()
    result = scan_continuously({"scan.length_mm": 140.0}, notes=notes, through=HeardThrough(blind))
    assert result.stop is StopReason.LENGTH
    assert any(name == ScanEvent.STEPWISE and "too few points" in d for name, d in notes.events)
    stepped = [k for k, s in enumerate(result.sections) if s.view.substep is Substep.CORRECTION]
    assert len(stepped) == result.counts.stepwise == 2
    origins = np.array([s.T_b_g[:3, 3] for s in result.sections[stepped[-1] :]])
    assert np.linalg.norm(np.diff(origins, axis=0), axis=1).max() < 4.5e-3  # followed from there


class StopsAt(Notes):
    """Asks for a stop with the section of a number."""

    def __init__(self, ask: object, index: int) -> None:
        super().__init__()
        self._ask, self._index = ask, index

    def record(self, message: object) -> None:
        super().record(message)
        if isinstance(message, ScannedSection) and message.view.index == self._index:
            self._ask()  # type: ignore[operator]


def test_a_stop_after_the_section_ends_at_rest_on_the_path() -> None:
    stop = StopRequest()
    notes = StopsAt(stop.request_stop_after_section, 20)
    result = scan_continuously({"scan.length_mm": 300.0}, notes=notes, stop=stop)
    assert len(result.sections) < 50  # of 170
    assert result.stop is StopReason.REQUESTED
    assert flange_speeds(passing_views(notes))[-3:].max() < AT_REST


def test_a_stop_now_leaves_what_was_measured() -> None:
    stop = StopRequest()
    notes = StopsAt(stop.request_stop_now, 20)
    with pytest.raises((ArmFault, Exception)) as raised:
        scan_continuously({}, notes=notes, stop=stop)
    assert type(raised.value).__name__ == "ScanInterrupted"
    assert len(notes.sections) == 21
    assert isinstance(notes.views[-1], ProfileView)


def test_a_groove_that_closes_ends_the_scan_where_it_began(monkeypatch: pytest.MonkeyPatch) -> None:
    away = iter([*[1.0] * 29, *[0.0] * 99])  # of sections from the first one
    monkeypatch.setattr("tjscan.scanning.continuous.scanner.dist", lambda a, b: next(away))
    notes = Notes()
    result = scan_continuously({"scan.length_mm": 300.0}, notes=notes)
    assert result.stop is StopReason.CLOSED
    assert len(result.sections) == 31
    assert flange_speeds(passing_views(notes))[-3:].max() < AT_REST


@pytest.mark.parametrize("hidden", [range(190), range(60, 400)], ids=["first", "most"])
def test_a_shuttle_that_does_not_see_the_groove_all_the_way_is_refused(hidden: range) -> None:
    blank = np.full(640, np.nan)

    class Blinded(HeardThrough):
        def stream(self, period: float) -> Iterator[StreamedProfile | None]:
            for n, streamed in enumerate(self.laser.stream(period)):
                hides = replace(streamed.profile, x_s=blank, z_s=blank)
                yield StreamedProfile(hides) if n in hidden else streamed

    with pytest.raises(LaserFault, match="quarters"):
        scan_continuously({}, through=Blinded(lambda n, profile: profile))


@pytest.mark.parametrize("rate", [0.0, -1.0, 1e3], ids=["constant", "backwards", "milliseconds"])
def test_stamps_that_are_no_times_are_refused_at_the_shuttle(rate: float) -> None:
    class Stamped(HeardThrough):
        def stream(self, period: float) -> Iterator[StreamedProfile | None]:
            for streamed in self.laser.stream(period):
                profile = streamed.profile
                yield StreamedProfile(replace(profile, time=rate * profile.time))

    with pytest.raises(LaserFault, match="evenly"):
        scan_continuously({}, through=Stamped(lambda n, profile: profile))


def test_stamps_that_leap_end_the_scan_as_a_fault() -> None:
    def leaps(n: int, profile: Profile | None) -> Profile | None:
        late = 0.4 if n > 200 else 0.0
        return None if profile is None else replace(profile, time=profile.time + late)

    with pytest.raises(LaserFault, match="leaps"):
        scan_continuously({}, through=HeardThrough(leaps))


def test_profiles_taken_before_the_arm_follows_are_left_out() -> None:
    class Buffering(HeardThrough):
        def stream(self, period: float) -> Iterator[StreamedProfile | None]:
            for n, streamed in enumerate(self.laser.stream(period)):
                early = replace(streamed.profile, time=streamed.profile.time - 0.5)
                yield StreamedProfile(early) if n < 2 else streamed

    notes = Notes()
    result = scan_continuously({}, notes=notes, through=Buffering(lambda n, profile: profile))
    assert result.stop is StopReason.LENGTH
    times = [view.time for view in notes.views if view.substep is Substep.PASSING]
    assert np.diff(times).max() < 0.5  # nor is one taken for later


def test_what_is_not_seen_on_the_way_is_gone_back_to() -> None:
    notes = Notes()
    silent = HeardThrough(lambda n, profile: None if 300 <= n < 380 else profile)
    result = scan_continuously({}, notes=notes, through=silent)
    assert result.counts.retreats >= 1
    steps = np.linalg.norm(np.diff([s.T_b_g[:3, 3] for s in result.sections], axis=0), axis=1)
    assert steps.max() < 4.5e-3


def test_a_scan_that_goes_on_by_single_steps_leaves_nothing_out() -> None:
    stop = StopRequest()
    notes = StopsAt(stop.pause, 20)
    original = notes.record

    def record(message: object) -> None:
        original(message)
        if isinstance(message, RunEvent) and message.name == ScanEvent.PAUSED:
            stop.go_one_step() if len(notes.sections) < 26 else stop.go_on()

    notes.record = record  # type: ignore[method-assign]
    result = scan_continuously({}, notes=notes, stop=stop)
    assert result.stop is StopReason.LENGTH
    steps = np.linalg.norm(np.diff([s.T_b_g[:3, 3] for s in result.sections], axis=0), axis=1)
    assert steps.max() < 4.5e-3


def test_poses_that_a_hand_turned_by_5_degrees_leave_no_corner_wrong_that_is_stated_as_sure() -> (
    None
):
    """The sensor's middle goes 34° off the groove from one to the other."""
    result = scan_continuously(
        {
            "scan.length_mm": 12.0,
            "scan.first": {
                "position_mm": [-58.4, 947.3, 360.5],
                "euler_zyx_deg": [15.23, -66.16, 150.67],
            },
            "scan.second": {
                "position_mm": [-43.3, 701.3, 364.2],
                "euler_zyx_deg": [-9.61, -61.15, -157.43],
            },
        }
    )
    given = replace(result, sections=finished_sections(result.sections))
    steps = np.linalg.norm(np.diff([s.T_b_g[:3, 3] for s in given.sections], axis=0), axis=1)
    assert steps.max() < 8e-3
    variances = [s.groove.corner_covariances_s for s in given.sections]
    sigmas = 1e3 * np.sqrt(np.trace(variances, axis1=2, axis2=3))
    assert (1e3 * example_corner_errors(given) < 0.3 + 5 * sigmas).all()


def test_poses_that_lead_the_other_way_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="behind it"):
        scan_continuously({"scan.direction": "clockwise"})


@pytest.mark.parametrize(
    "key", [{"scan.speed_mm_s": 300.0}, {"scan.horizon_mm": 40.0}], ids=["speed", "horizon"]
)
def test_what_the_arm_cannot_follow_is_refused_with_the_figure_that_does(
    key: dict[str, float],
) -> None:
    notes, name = Notes(), next(iter(key))
    with pytest.raises(ConfigurationError) as refused:
        scan_continuously(key, notes=notes)
    assert refused.value.key == name
    assert not notes.views  # nothing moved
    does, *slower = re.findall(r"to (\d+) at", refused.value.message)
    others = [key | {"scan.speed_mm_s": float(one)} for one in slower]
    for keys in ({name: float(does)}, *others):
        result = scan_continuously(keys | {"scan.length_mm": 20.0})
        assert result.stop is StopReason.LENGTH
