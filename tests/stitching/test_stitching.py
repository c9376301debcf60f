"""Stations stitched: laws on exact stations, figures on simulated ones, refusals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from exact_stations import exact_station
from free_stations import CAD, Cast, joint_named, true_station
from scipy.spatial.transform import Rotation

from tjscan.comparison.distance import corner_to_edge_distances
from tjscan.core import pose_vector
from tjscan.core.errors import ConfigurationError, StitchingRefused
from tjscan.core.frames import (
    Array,
    inverse_pose,
    pose,
    pose_from_euler_zyx,
    rotation_angle_between,
)
from tjscan.joint.edges import feature_edges
from tjscan.joint.tubes.fit import ArmRepeatability
from tjscan.runs.stations.stitch import build_stitching_report
from tjscan.stitching.picture import draw_stitching
from tjscan.stitching.registration import StitchingDraft
from tjscan.stitching.stations import Station, StitchSettings
from tjscan.stitching.stitch import StitchedGroove

NAMES = sorted(file.stem for file in CAD.glob("?joint-*.toml"))
PAPERS = "tjoint-600x457"
HALF_TURN = np.diag((-1.0, -1.0, 1.0, 1.0))
EXACT = 1e-6
"""Metres and radians: what unrolling 40 mm steps smoothly leaves."""


def arc(start_deg: float, end_deg: float, step_deg: float = 10.0) -> Array:
    return np.asarray(np.radians(np.arange(start_deg, end_deg + 1e-9, step_deg)))


def two(
    joint: str = PAPERS,
    seed: int = 0,
    arm: ArmRepeatability | None = None,
    T_w_j: Array | None = None,
) -> tuple[list[Station], list[Array]]:
    """Exact stations left and right that overlap by 30° at both crowns; where they truly stand."""
    arm = ArmRepeatability(0.0, 0.0) if arm is None else arm
    made = [
        exact_station(joint_named(joint), name, arc(*ends), seed=seed, arm=arm, T_w_j=T_w_j)
        for name, ends in (("left", (-15.0, 195.0)), ("right", (167.0, 377.0)))
    ]
    return [station for station, _ in made], [T_j_b for _, T_j_b in made]


def off_truth(stitched: StitchedGroove, truth: Sequence[Array]) -> list[Array]:
    """What would bring the true place of each station to the one found, half a turn apart."""
    apart = [
        max(
            rotation_angle_between(one.T_j_b, turn @ T)
            for one, T in zip(stitched.stations, truth, strict=True)
        )
        for turn in (np.eye(4), HALF_TURN)
    ]
    turn = (np.eye(4), HALF_TURN)[int(np.argmin(apart))]
    return [
        one.T_j_b @ inverse_pose(turn @ T) for one, T in zip(stitched.stations, truth, strict=True)
    ]


def same(one: StitchedGroove, other: StitchedGroove, turn: Array, tolerance: float = 1e-9) -> None:
    names, others = ([p.fit.station.name for p in groove.stations] for groove in (one, other))
    assert names == others
    for a, b in zip(one.stations, other.stations, strict=True):
        np.testing.assert_allclose(turn @ a.T_j_b, b.T_j_b, atol=tolerance)
    assert len(one.sections) == len(other.sections)


@pytest.mark.parametrize("name", NAMES)
def test_exact_stations_are_placed_exactly(name: str) -> None:
    stations, truth = two(name)
    stitched = StitchedGroove(stations)
    # The leaning joint's groove angle is prescribed with a kink, which is not smooth.
    tolerance = 20 * EXACT if name.startswith("y") else EXACT
    for T in off_truth(stitched, truth):
        assert np.abs(pose_vector.pose_to_vector(T)).max() < tolerance
    joint = joint_named(name)
    assert stitched.shape.as_array == pytest.approx(
        (joint.brace_radius, joint.leg_radius, joint.angle, 0.0), abs=EXACT
    )
    assert stitched.covered == pytest.approx(2 * np.pi)
    assert stitched.gap_after is not None
    assert stitched.gap_after < tolerance


def test_exact_sections_are_fused_exactly() -> None:
    stations, _ = two()
    stitched = StitchedGroove(stations)
    fused = [section for section in stitched.sections if section.station == "left+right"]
    assert len(fused) == 8
    corners = np.array([section.points for section in fused])
    # Half a step along the groove, its shape follows a smooth curve to a few micrometres.
    assert corner_to_edge_distances(corners, feature_edges(joint_named(PAPERS))).max() < 1e-5


def test_the_order_of_the_stations_changes_nothing() -> None:
    stations, _ = two(arm=ArmRepeatability())
    same(StitchedGroove(stations), StitchedGroove(stations[::-1]), np.eye(4), 1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_turning_the_workpiece_changes_nothing_but_perhaps_half_a_turn(seed: int) -> None:
    T_w_j = pose(Rotation.random(rng=seed).as_matrix(), (3.0, -2.0, 1.0))
    still, _ = two(arm=ArmRepeatability())
    turned, _ = two(arm=ArmRepeatability(), T_w_j=T_w_j)
    one, other = StitchedGroove(still), StitchedGroove(turned)
    x = one.stations[0].T_j_b[0, :3] @ other.stations[0].T_j_b[0, :3]
    same(one, other, np.eye(4) if x > 0 else HALF_TURN)


def test_moving_a_base_moves_its_pose_and_nothing_else() -> None:
    # The same views, told in a base frame that stands elsewhere.
    still, truth = two(seed=1)
    moved, elsewhere = two(seed=2)
    one, other = StitchedGroove(still), StitchedGroove(moved)
    for a, b in zip(one.sections, other.sections, strict=True):
        np.testing.assert_allclose(a.points, b.points, atol=EXACT)
    assert not np.allclose(truth[0], elsewhere[0])


def test_the_errors_of_the_poses_are_as_large_as_stated() -> None:
    # Normalised error squared is 1 in the mean; 12 draws of two stations that share the joint
    # spread it by some 0.2. The walls' own noise is put in as stated, for there is none here.
    arm, squares = ArmRepeatability(), []
    settings = StitchSettings(repeatability=arm, out_of_round=1e-8)
    for seed in range(12):
        stations, truth = two(seed=seed, arm=arm)
        stitched = StitchedGroove(stations, settings)
        for one, T in zip(stitched.stations, off_truth(stitched, truth), strict=True):
            error = pose_vector.pose_to_vector(T)
            squares.append(error @ np.linalg.solve(one.covariance, error) / 6)
    assert 0.6 < np.mean(squares) < 1.5


def test_errors_shrink_with_the_arms() -> None:
    sizes = []
    for scale in (1.0, 0.1):
        arm = ArmRepeatability(scale * 5e-5, scale * 1e-4)
        stations, truth = two(seed=3, arm=arm)
        errors = off_truth(StitchedGroove(stations, StitchSettings(arm, out_of_round=1e-8)), truth)
        sizes.append(max(float(np.linalg.norm(T[:3, 3])) for T in errors))
    assert sizes[1] < 0.2 * sizes[0]


def test_a_view_that_is_wrong_by_a_millimetre_is_not_listened_to() -> None:
    stations, truth = two(arm=ArmRepeatability(1e-5, 1e-5), seed=4)
    sections = list(stations[1].all_sections)
    bad = sections[1]
    sections[1] = replace(
        bad, view=replace(bad.view, T_b_s=pose(p=(1e-3, 1e-3, 0)) @ bad.view.T_b_s)
    )
    wrong = replace(stations[1], all_sections=tuple(sections))
    stitched = StitchedGroove([stations[0], wrong], StitchSettings(ArmRepeatability(1e-5, 1e-5)))
    for T in off_truth(stitched, truth):
        assert np.linalg.norm(T[:3, 3]) < 5e-5
    assert sum(int((~edge.counted).sum()) for edge in stitched.registrations) >= 1


@pytest.mark.parametrize("oval", [0.5e-3, 2e-3])
def test_stations_fit_each_other_though_tubes_are_out_of_round(oval: float) -> None:
    arm = ArmRepeatability()
    made = [
        exact_station(joint_named(PAPERS), name, arc(*ends), arm=arm, seed=1, oval=oval)
        for name, ends in (("left", (-15.0, 195.0)), ("right", (167.0, 377.0)))
    ]
    stitched = StitchedGroove([station for station, _ in made])
    left, right = off_truth(stitched, [T_j_b for _, T_j_b in made])
    between = pose_vector.pose_to_vector(inverse_pose(left) @ right)
    assert np.linalg.norm(between[:3]) < 0.1e-3
    assert np.linalg.norm(between[3:]) < np.radians(0.02)
    assert 0.1 * oval < stitched.out_of_round <= 2 * oval
    # Frame j itself is as uncertain as it has to be.
    assert np.linalg.norm(left[:3, 3]) < 4 * np.sqrt(
        np.trace(stitched.stations[0].covariance[:3, :3])
    )


def test_tubes_far_out_of_round_are_refused() -> None:
    made = [
        exact_station(joint_named(PAPERS), name, arc(*ends), oval=2e-3)[0]
        for name, ends in (("left", (-15.0, 195.0)), ("right", (167.0, 377.0)))
    ]
    error = refusal(made, StitchSettings(most_out_of_round=1e-4))
    assert error.reason == "overlaps and tubes disagree"
    assert "out of round by more than 0.1 mm" in str(error)


@cache
def simulated(
    name: str, arcs: tuple[tuple[str, float, float], ...]
) -> tuple[StitchedGroove, list[Array]]:
    made = [true_station(who, start, length, 1, Cast(joint=name)) for who, start, length in arcs]
    ordered = sorted(made, key=lambda one: one[0].name)
    return StitchedGroove([station for station, _ in made]), [T_j_b for _, T_j_b in ordered]


LEFT_RIGHT = (("left", -15.0, 210.0), ("right", 165.0, 210.0))
FOUR = (("a", -20.0, 130.0), ("b", 200.0, -130.0), ("c", 160.0, 130.0), ("d", 250.0, 130.0))


@pytest.mark.parametrize(
    ("name", "arcs"),
    [(PAPERS, LEFT_RIGHT), ("tjoint-406x324", LEFT_RIGHT), (PAPERS, FOUR)],
    ids=["paper's", "smaller", "four stations, one of them clockwise"],
)
def test_simulated_stations_are_stitched_as_well_as_promised(
    name: str, arcs: tuple[tuple[str, float, float], ...]
) -> None:
    stitched, truth = simulated(name, arcs)
    # Four stations see less of the tubes each, and know less of where they are.
    for T in off_truth(stitched, truth):
        assert np.linalg.norm(T[:3, 3]) < (0.1e-3 if len(arcs) == 2 else 0.2e-3)
        assert rotation_angle_between(np.eye(4), T) < np.radians(0.02 if len(arcs) == 2 else 0.04)
    joint = joint_named(name)
    assert 2 * stitched.shape.brace_radius == pytest.approx(2 * joint.brace_radius, abs=0.3e-3)
    assert 2 * stitched.shape.leg_radius == pytest.approx(2 * joint.leg_radius, abs=0.3e-3)
    assert stitched.covered == pytest.approx(2 * np.pi)
    assert stitched.gap_after is not None
    assert stitched.gap_after < 0.1e-3
    errors = corner_to_edge_distances(
        np.array([s.points for s in stitched.sections]), feature_edges(joint)
    )
    # One draw of the noise: a tenth more than the 0.1 mm that the bench holds over its seeds.
    assert errors.mean() < 0.11e-3
    assert np.percentile(errors, 95) < 0.25e-3


def test_sections_come_by_azimuth_each_place_once_and_fused_ones_are_surer() -> None:
    stitched, _ = simulated(PAPERS, LEFT_RIGHT)
    azimuths = np.array([section.azimuth for section in stitched.sections])
    assert (np.diff(azimuths) > np.radians(4)).all()
    size = {
        fused: np.mean(
            [np.trace(s.covariances[1]) for s in stitched.sections if ("+" in s.station) == fused]
        )
        for fused in (True, False)
    }
    assert size[True] < 0.8 * size[False]


def test_what_is_told_is_in_millimetres_and_degrees() -> None:
    stitched, _ = simulated(PAPERS, LEFT_RIGHT)
    told = build_stitching_report(stitched, {"left": "left"})
    assert told.brace_diameter_mm == pytest.approx(457.2, abs=0.3)
    assert told.angle_deg == pytest.approx(90, abs=0.05)
    left, right = told.stations
    assert left.source == "left"
    assert left.nominal_off_mm == pytest.approx(0, abs=1e-9)
    assert 1 < right.nominal_off_mm < 60  # 10 mm, and 2° over more than a metre
    assert 0.1 < right.nominal_off_deg < 4.1
    T = pose_from_euler_zyx(1e-3 * np.array(left.position_mm), np.radians(left.euler_zyx_deg))
    np.testing.assert_allclose(T, stitched.stations[0].T_j_b, atol=1e-12)


def refusal(
    stations: Sequence[Station], settings: StitchSettings | None = None
) -> StitchingRefused:
    with pytest.raises(StitchingRefused) as caught:
        StitchedGroove(stations, settings or StitchSettings())
    return caught.value


def exact(name: str, start: float, end: float, joint: str = PAPERS, **keys: float) -> Station:
    return exact_station(joint_named(joint), name, arc(start, end, **keys))[0]


def test_too_small_an_overlap_is_refused_with_its_place_and_size() -> None:
    error = refusal([exact("left", -15, 195), exact("right", 167, 347.5, step_deg=9.5)])
    assert error.reason == "overlap too small"
    assert "left and right" in str(error)
    assert "10° and 2 sections of each are needed" in str(error)
    assert "Teach" in str(error)
    assert isinstance(error.draft, StitchingDraft)
    assert draw_stitching(error.draft).axes


def test_a_small_overlap_that_a_third_station_bridges_is_no_harm() -> None:
    stations = [
        exact("a", -10, 182),
        exact("b", 176, 352),
        exact("c", 90, 270),
        exact("d", 300, 420),
    ]
    stitched = StitchedGroove(stations)
    assert len(stitched.registrations) == 4
    assert stitched.covered == pytest.approx(2 * np.pi)


def test_stations_that_do_not_meet_are_refused() -> None:
    error = refusal([exact("left", -60, 60), exact("right", 100, 230)])
    assert error.reason == "not connected"
    assert "left | right" in str(error)
    assert "left reaches from -60° to 60°" in str(error)


def test_an_overlap_at_one_end_alone_leaves_the_way_round_open() -> None:
    stitched = StitchedGroove([exact("left", -15, 195), exact("right", 167, 317)])
    assert stitched.gap_before is None
    assert stitched.gap_after is None
    assert np.degrees(stitched.covered) == pytest.approx(332, abs=1)


def test_stations_that_saw_different_joints_are_refused() -> None:
    other = exact_station(joint_named("yjoint-600x457-60deg"), "right", arc(167, 377))[0]
    error = refusal([exact("left", -15, 195), other])
    assert error.reason == "overlap contradicts itself"
    assert "must show the same joint" in str(error)


def test_a_station_that_sees_too_little_of_the_tubes_is_refused_by_name() -> None:
    error = refusal([exact("left", -15, 195), exact("right", 180, 200)])
    assert error.reason == "joint not found"
    assert "station right, 3 sections" in str(error)


@pytest.mark.parametrize("count", range(5))
def test_a_station_that_found_all_but_nothing_is_refused_by_name(count: int) -> None:
    right = exact("right", 167, 377)
    cut = replace(right, sections=right.sections[:count], all_sections=right.all_sections[:count])
    error = refusal([exact("left", -15, 195), cut])
    assert error.reason == "joint not found"
    assert f"station right, {count} sections" in str(error)


def test_stations_need_names_of_their_own_and_company() -> None:
    with pytest.raises(ConfigurationError, match="two stations or more"):
        StitchedGroove([exact("left", -15, 195)])
    with pytest.raises(ConfigurationError, match="2 stations are called left"):
        StitchedGroove([exact("left", -15, 195), exact("left", 167, 377)])


@pytest.mark.parametrize("seed", range(3))
def test_a_nominal_pose_too_far_off_to_tell_the_side_is_refused(seed: int) -> None:
    (left, right), _ = two()
    stitched = StitchedGroove([left, right])
    rng = np.random.default_rng(seed)
    for turn, refused in ((20.0, False), (100.0, True)):
        axis = rng.standard_normal(3)
        off = Rotation.from_rotvec(np.radians(turn) * axis / np.linalg.norm(axis)).as_matrix()
        away = right.T_w_b[:3, 3] + rng.uniform(-0.05, 0.05, 3)
        doubtful = [left, replace(right, T_w_b=pose(off @ right.T_w_b[:3, :3], away))]
        if refused:
            with pytest.raises(StitchingRefused, match="nominal poses disagree") as caught:
                StitchedGroove(doubtful)
            assert "stations left and right" in str(caught.value)
        else:
            same(stitched, StitchedGroove(doubtful), np.eye(4))


def test_a_recording_given_twice_is_refused_under_any_name() -> None:
    (left, right), _ = two()
    with pytest.raises(ConfigurationError, match="left and other hold the same recording"):
        StitchedGroove([left, right, replace(left, name="other")])
    part = replace(
        left, name="part", sections=left.sections[:9], all_sections=left.all_sections[:9]
    )
    with pytest.raises(ConfigurationError, match="same recording"):
        StitchedGroove([left, part])


def test_an_uncertain_arm_leaves_an_overlap_too_uncertain() -> None:
    stations, _ = two()
    error = refusal(stations, StitchSettings(repeatability=ArmRepeatability(2e-3, 4e-3)))
    assert error.reason == "overlap too small"
    assert "uncertain by" in str(error)
