"""A plan along a groove: volume, scaling, mirror, windows, zones, starts, and what is refused."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plates import half_v, sheared_groove
from ringed_grooves import corners_along_arc, edges_of

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.planning.path import LARGEST_CHORD_ERROR, LARGEST_KINK, chord_error_and_kink
from tjscan.planning.plan import WeldPlan, number_beside, plan_weld
from tjscan.planning.wps import (
    PositionLimits,
    StartStopSettings,
    WeldingProcedure,
    read_wps,
)

EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "wps.toml"
DOWN = np.array((0.0, 0.0, -1.0))
SECTION = sheared_groove(root=6e-3, depth=22e-3, opening=0.95, slope=0.1, tilt=0.1)


def wps(**tables: dict[str, object]) -> WeldingProcedure:
    """The example's, with values of its tables replaced, in SI units."""
    found = read_wps(EXAMPLE).model_copy(update={"start_stop": None})
    return found.model_copy(
        update={name: replace(getattr(found, name), **keys) for name, keys in tables.items()}
    )


def all_beads(least: float, most: float) -> dict[str, dict[str, object]]:
    """One window, m², for beads of any kind."""
    return {"bead": dict.fromkeys(("root_area", "fill_area", "cap_area"), (least, most))}


def ring(growth: float = 0.2, **arc: float) -> Array:
    return corners_along_arc(SECTION, growth=growth, **arc)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def plan() -> WeldPlan:
    return plan_weld(edges_of(ring()), wps(), DOWN)


def test_every_sample_is_within_the_windows_that_the_plan_was_made_for(plan: WeldPlan) -> None:
    procedure = plan.wps
    for bead in plan.beads:
        for values, window in (
            (bead.speed, procedure.arc.travel_speed),
            (bead.heat, procedure.arc.heat_input),
            (bead.area, getattr(procedure.bead, f"{bead.kind}_area")),
        ):
            assert values.min() >= window[0]
            assert values.max() <= window[1]
    assert not [f for f in plan.findings if f.key != "sequence.positions"]
    assert len(plan.zones) == 1


def test_what_the_wire_brings_is_the_groove_by_pappus(plan: WeldPlan) -> None:
    """A section that is turned about an axis fills its area times the way of its centre."""
    edges = edges_of(ring(growth=0.0))
    found = plan_weld(edges, wps(bead={"cap_height": 0.0}, sequence={"overlap": 0.0}), DOWN)
    x, y = SECTION.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = 0.5 * cross.sum()
    centre = 0.25 + ((x + np.roll(x, -1)) * cross).sum() / (6 * area)
    assert found.volume == pytest.approx(2 * np.pi * centre * area, rel=2e-4)
    deposited = sum(
        float(found.wps.deposition_rate(b.feed).mean()) * b.arc_time for b in found.beads
    )
    assert deposited == pytest.approx(found.volume, rel=1e-4)


def test_beads_are_numbered_in_their_order_and_closed_by_an_overlap(plan: WeldPlan) -> None:
    assert [bead.number for bead in plan.beads] == list(range(1, len(plan.beads) + 1))
    assert plan.edges.closed
    for bead in plan.beads:
        over = abs(bead.s[-1] - bead.s[0]) - plan.edges.length
        assert over == pytest.approx(plan.wps.sequence.overlap)


def test_starts_of_neighbouring_layers_stand_apart(plan: WeldPlan) -> None:
    starts = {bead.layer: bead.s[0] for bead in plan.beads}
    spread = np.diff([starts[k] for k in sorted(starts)])
    np.testing.assert_allclose(spread, plan.wps.sequence.start_spread)


def test_paths_are_sampled_finely_enough_and_never_turn_back(plan: WeldPlan) -> None:
    for bead in plan.beads:
        points = bead.points[:, None]
        # Of a circle's chords: the middle stands off by a quarter of what a chord of two leaves.
        error, kink = chord_error_and_kink(points[::2], points[1:-1:2][: len(points[::2]) - 1])
        assert error <= 4 * LARGEST_CHORD_ERROR
        assert chord_error_and_kink(points, 0.5 * (points[1:] + points[:-1]))[1] <= LARGEST_KINK
        steps = np.diff(bead.points, axis=0)
        assert (np.sum(steps[1:] * steps[:-1], axis=1) > 0).all()
        assert kink < np.pi / 2


def test_torch_frames_are_right_handed_and_point_into_the_groove(plan: WeldPlan) -> None:
    for bead in plan.beads:
        R = bead.T_r_torch[:, :3, :3]
        np.testing.assert_allclose(R @ R.transpose(0, 2, 1), len(R) * [np.eye(3)], atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(R), 1)
        assert (R[:, 2, 2] < 0).all()  # the groove opens upwards


def test_the_torch_leans_by_its_travel_angle_however_the_section_changes() -> None:
    lean = np.radians(5.0)
    for reverse in (False, True):
        procedure = wps(torch={"travel_angle": lean}, sequence={"reverse": reverse})
        for bead in plan_weld(edges_of(ring(0.4)), procedure, DOWN).beads:
            travel = np.gradient(bead.points, axis=0)[1:-1]
            travel /= np.linalg.norm(travel, axis=1, keepdims=True)
            leans = np.arcsin(np.sum(travel * bead.T_r_torch[1:-1, :3, 2], axis=1))
            np.testing.assert_allclose(leans, lean, atol=1e-3)


def test_how_the_torch_is_held_is_not_in_which_position_is_welded(plan: WeldPlan) -> None:
    """Slope and rotation of ISO 6947 are those of the weld, not of the torch."""
    held = plan_weld(edges_of(ring()), wps(torch={"work_angle": 0.6, "travel_angle": 0.4}), DOWN)
    for one, other in zip(plan.beads, held.beads, strict=True):
        np.testing.assert_allclose(other.rotation, one.rotation, atol=1e-12)
        assert other.positions == one.positions


def test_a_groove_that_is_scaled_takes_speeds_by_the_inverse_square() -> None:
    scale = 1.3

    def scaled(size: float) -> WeldingProcedure:
        area = (15e-6 * size**2, 45e-6 * size**2)
        return wps(
            bead=dict.fromkeys(("root_area", "fill_area", "cap_area"), area)
            | {"layer_height": (2e-3 * size, 6.5e-3 * size), "cap_height": 2e-3 * size},
            arc={"travel_speed": (1e-4, 1.0), "heat_input": (1.0, 1e9)},
            sequence={"start_spread": 30e-3 * size, "overlap": 15e-3 * size},
        )

    one = plan_weld(edges_of(ring()), scaled(1.0), DOWN)
    other = plan_weld(edges_of(scale * ring()), scaled(scale), DOWN)
    counts = [p.zones[0].arrangement.counts for p in (one, other)]
    assert counts[0] == counts[1]
    for a, b in zip(one.beads, other.beads, strict=True):
        for values, power in (("area", 2), ("speed", -2)):
            x, y = getattr(a, values), getattr(b, values)
            assert y[0] / x[0] == pytest.approx(scale**power, rel=1e-3)
            assert y.mean() / x.mean() == pytest.approx(scale**power, rel=2e-3)


def test_a_mirrored_groove_has_the_mirrored_plan() -> None:
    mirror = np.array((1.0, -1.0, 1.0))
    procedure = wps(torch={"travel_angle": 0.1, "work_angle": 0.05})
    one = plan_weld(edges_of(ring()), procedure, DOWN)
    other = plan_weld(edges_of(mirror * ring()), procedure, DOWN)
    for a, b in zip(one.beads, other.beads, strict=True):
        np.testing.assert_allclose(b.points, mirror * a.points, atol=1e-9)
        np.testing.assert_allclose(b.speed, a.speed, rtol=1e-6)
        for axis in (0, 2):
            np.testing.assert_allclose(
                b.T_r_torch[:, :3, axis], mirror * a.T_r_torch[:, :3, axis], atol=1e-6
            )
        assert a.positions == b.positions


def test_zones_only_where_no_count_fits_the_whole() -> None:
    tight: dict[str, object] = {"travel_speed": (4.5e-3, 5.5e-3), "wire_feed": (0.15, 0.155)}
    edges = edges_of(ring(growth=0.25, turn=np.pi))
    assert len(plan_weld(edges, wps(), DOWN).zones) == 1
    zones = plan_weld(edges, wps(arc=tight), DOWN).zones
    assert len(zones) > 1
    assert zones[0].begin == 0.0
    assert zones[-1].end == pytest.approx(edges.length)
    for a, b in pairwise(zones):
        assert a.end == b.begin


def test_zones_of_a_groove_that_closes_are_not_cut_where_the_sections_begin() -> None:
    """They begin where the section is smallest: one zone reaches to both sides of that."""
    tight: dict[str, object] = {"travel_speed": (4.5e-3, 5.5e-3), "wire_feed": (0.15, 0.155)}
    edges = edges_of(ring(growth=0.25, radius=0.1))
    plan = plan_weld(edges, wps(arc=tight), DOWN)
    zones = plan.zones
    assert len(zones) > 1
    assert sum(zone.end - zone.begin for zone in zones) == pytest.approx(edges.length)
    for zone in zones:
        begin = zone.begin % edges.length
        assert min(begin, edges.length - begin) > 0.05 * edges.length
    for number, zone in enumerate(zones, start=1):
        beads = [b for b in plan.beads if b.zone == number and b.layer == 1]
        ends = [(b.s[0], b.s[-1] - plan.wps.sequence.overlap) for b in beads]
        assert ends == [pytest.approx((zone.begin, zone.end))]
    # The windows hold where beads lap over the zone that follows, too.
    assert {f.key for f in plan.findings} <= {"sequence.positions", "sequence.start_spread_mm"}


@pytest.mark.parametrize(
    ("tables", "key"),
    [
        ({"arc": {"travel_speed": (20e-3, 21e-3)}}, "arc.travel_speed_mm_min"),
        (all_beads(80e-6, 120e-6), "bead.root_area_mm2"),
        ({"bead": {"layer_height": (30e-3, 31e-3)}}, "bead.layer_height_mm"),
        (all_beads(1.0, 2.0), "bead.fill_area_mm2"),
    ],
)
def test_windows_that_nothing_fits_are_refused_with_key_and_place(
    tables: dict[str, dict[str, object]], key: str
) -> None:
    with pytest.raises(ConfigurationError, match="at s = ") as error:
        plan_weld(edges_of(ring()), wps(**tables), DOWN)
    assert error.value.key == key


@pytest.mark.parametrize(("gap", "too"), [(60e-3, "too wide"), (1e-3, "too narrow")])
def test_a_root_that_one_bead_can_t_span_is_refused(gap: float, too: str) -> None:
    flat = half_v(angle=10.0, gap=gap)
    x = np.linspace(0, 0.4, 12)
    corners = np.stack(np.broadcast_arrays(x[:, None], flat[:, 0], flat[:, 1]), axis=2)
    with pytest.raises(ConfigurationError, match=too) as error:
        plan_weld(edges_of(corners), wps(), np.array((0.0, -1.0, 0.0)))
    assert error.value.key == "bead.root_area_mm2"


def test_heat_that_fits_nowhere_is_named() -> None:
    found = plan_weld(edges_of(ring()), wps(arc={"heat_input": (1.0, 2.0)}), DOWN)
    named = {f.bead for f in found.findings if f.key == "arc.heat_input_kJ_mm"}
    assert named == {bead.number for bead in found.beads}


@pytest.mark.parametrize(
    ("spoil", "key", "says"),
    [
        (lambda p: p[np.r_[0:5, 6, 5, 7 : len(p)]], "sections", "out of order"),
        (lambda p: np.delete(p, [7, 8, 9, 10, 11], axis=0), "sequence.longest_step_mm", "missing"),
        (lambda p: p[:, [0, 2, 1, 3]], "sections", "convex"),
    ],
)
def test_sections_that_are_no_groove_are_refused(spoil: object, key: str, says: str) -> None:
    with pytest.raises(ConfigurationError, match=says) as error:
        plan_weld(edges_of(spoil(ring())), wps(), DOWN)  # type: ignore[operator]
    assert error.value.key == key


def test_a_plate_s_half_v_is_planned_by_its_closed_form() -> None:
    """A straight groove: the speed is deposition rate / (area / beads), to rounding."""
    flat = half_v()
    x = np.linspace(0, 0.4, 12)
    corners = np.stack(np.broadcast_arrays(x[:, None], flat[:, 0], flat[:, 1]), axis=2)
    procedure = wps(bead={"cap_height": 0.0})
    found = plan_weld(edges_of(corners), procedure, np.array((0.0, -1.0, 0.0)))
    area = 6e-3 * 25.4e-3 + 0.5 * 25.4e-3**2 * np.tan(np.radians(50))
    n = len(found.beads)
    for bead in found.beads:
        rate = float(procedure.deposition_rate(bead.feed[0]))
        np.testing.assert_allclose(bead.speed, rate / (area / n), rtol=1e-6)
    assert found.volume == pytest.approx(area * 0.4, rel=1e-6)
    assert not found.edges.closed


def test_beyond_the_limit_of_slope_a_bead_climbs_or_falls() -> None:
    """A ring whose axis leans by 24° goes up by as much at one side, and down at the other."""
    lean, limit = np.radians(24.0), np.radians(15.0)
    down = np.array((0.0, -np.sin(lean), -np.cos(lean)))
    plan = plan_weld(edges_of(ring()), wps(sequence={"slope_limit": limit}), down)
    for bead in plan.beads:
        assert np.degrees(np.abs(bead.slope).max()) == pytest.approx(24.0, abs=1.0)
        names = np.array(bead.positions)
        np.testing.assert_array_equal(names == "PF", bead.slope > limit)
        np.testing.assert_array_equal(names == "PG", bead.slope < -limit)
    flat = plan_weld(edges_of(ring()), wps(sequence={"slope_limit": lean + 0.02}), down)
    assert {"PF", "PG"}.isdisjoint({name for bead in flat.beads for name in bead.positions})


def test_where_a_position_asks_for_less_wire_the_bead_goes_slower_and_lays_as_much() -> None:
    lean = np.radians(24.0)
    down = np.array((0.0, -np.sin(lean), -np.cos(lean)))
    procedure = wps(sequence={"slope_limit": np.radians(15.0)})
    less = PositionLimits(name="PF", wire_feed=(0.1, 0.14))
    full = plan_weld(edges_of(ring()), procedure, down)
    slower = plan_weld(edges_of(ring()), procedure.model_copy(update={"position": (less,)}), down)
    for one, other in zip(full.beads, slower.beads, strict=True):
        up = np.array(other.positions) == "PF"
        np.testing.assert_allclose(other.feed, np.where(up, 0.14, one.feed))
        np.testing.assert_allclose(other.area, one.area)
        np.testing.assert_allclose(other.speed, one.speed * other.feed / one.feed)
    keys = {finding.key for finding in slower.findings}
    assert "arc.travel_speed_mm_min" in keys or min(b.speed.min() for b in slower.beads) >= 4e-3


def test_every_bead_runs_in_and_ends_in_a_crater_as_the_wps_says() -> None:
    ends = StartStopSettings(
        run_in=8e-3, run_in_speed=1.25, crater=5e-3, crater_feed=0.7, crater_time=0.5
    )
    plain = wps(sequence={"reverse": True})
    plan = plan_weld(edges_of(ring()), plain.model_copy(update={"start_stop": ends}), DOWN)
    for one, bead in zip(plan_weld(edges_of(ring()), plain, DOWN).beads, plan.beads, strict=True):
        along = np.append(0.0, np.cumsum(bead.path_steps))
        inner = (along > 8.5e-3) & (along < along[-1] - 5.5e-3)
        own = np.interp(bead.s, one.s[::-1], one.speed[::-1])
        assert bead.speed[0] == pytest.approx(1.25 * own[0])
        assert bead.feed[-1] == pytest.approx(0.7 * one.feed[-1])
        np.testing.assert_allclose(bead.speed[inner], own[inner], rtol=1e-3)
        assert bead.area[0] == pytest.approx(one.area[0] / 1.25, rel=1e-6)
        assert bead.volume < one.volume


@given(st.floats(0.1, 1e4), st.floats(-1e-9, 1e-9) | st.floats(-0.6, 0.6))
def test_a_number_out_of_a_limit_never_reads_as_the_limit(limit: float, off: float) -> None:
    value = limit * (1 + off)
    rounded = float(number_beside(value, limit))
    assert (rounded > limit) == (value > limit)
    assert (rounded < limit) == (value < limit)
    assert rounded == pytest.approx(value, rel=0.006)
