"""Open roots, tack welds, and grooves that are welded in part."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plates import half_v
from ringed_grooves import edges_of

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.groove.measured import MeasuredSection
from tjscan.planning.document import beads_to_csv, plan_document, read_beads_csv
from tjscan.planning.edges import GrooveEdges, fit_groove_edges, root_state_along_sections
from tjscan.planning.path import (
    LARGEST_KINK,
    LONGEST_STATION_STEP,
    cut_groove_stations,
    map_template_onto,
)
from tjscan.planning.plan import plan_weld
from tjscan.planning.weldx_file import write_plan_as_weldx
from tjscan.planning.wps import WeldingProcedure, read_wps

EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "wps.toml"
UP = np.array((0.0, -1.0, 0.0))
LENGTH, COUNT, OPENING = 0.4, 12, 4e-3


def plate(
    *, is_open: bool = False, gap: Array | float = OPENING, tacked: tuple[int, ...] = ()
) -> GrooveEdges:
    """A straight groove of 12 sections."""
    flat = np.stack([half_v(gap=x) for x in np.broadcast_to(gap, COUNT).tolist()])
    x = np.broadcast_to(np.linspace(0, LENGTH, COUNT)[:, None, None], (COUNT, 4, 1))
    edges = edges_of(np.concatenate((x, flat), axis=2))
    root = replace(
        edges.root,
        openness=np.full(COUNT, float(is_open)),
        tacked=np.isin(np.arange(COUNT), tacked),
    )
    return replace(edges, root=root)


def wps(**root: object) -> WeldingProcedure:
    found = read_wps(EXAMPLE).model_copy(update={"start_stop": None})
    return found.model_copy(update={"root": replace(found.root, **root)})  # type: ignore[arg-type]


def test_an_open_root_takes_what_lies_below_it_into_its_root_bead() -> None:
    procedure = wps(penetration=3e-3)
    shut, wide = (plan_weld(plate(is_open=x), procedure, UP) for x in (False, True))
    assert wide.volume - shut.volume == pytest.approx(OPENING * 3e-3 * LENGTH, rel=1e-6)
    assert wide.beads[0].open_root
    assert not any(bead.open_root for bead in (*wide.beads[1:], *shut.beads))


def test_without_backing_the_root_bead_keeps_its_own_windows() -> None:
    window = (0.105, 0.11)
    bare = plan_weld(plate(is_open=True), wps(backing=False, wire_feed=window), UP)
    backed = plan_weld(plate(is_open=True), wps(backing=True, wire_feed=window), UP)
    assert window[0] <= bare.beads[0].feed.min() <= bare.beads[0].feed.max() <= window[1]
    assert backed.beads[0].feed == pytest.approx(backed.wps.arc.wire_feed[1])
    assert bare.beads[1].feed == pytest.approx(bare.wps.arc.wire_feed[1])


def test_an_opening_out_of_its_window_is_named_with_its_place() -> None:
    opening = np.linspace(3e-3, 8e-3, COUNT)
    found = plan_weld(plate(is_open=True, gap=opening), wps(opening=(2e-3, 6e-3)), UP)
    (one,) = [f for f in found.findings if f.key == "root.opening_mm"]
    wide = np.linspace(0, LENGTH, COUNT)[opening > 6e-3]
    assert (one.begin, one.end) == pytest.approx((wide[0], wide[-1]))
    assert "8, allowed 2 to 6" in one.text


def test_tacks_are_fused_or_skipped_as_the_wps_says() -> None:
    tacked = plate(tacked=(4, 5))
    at = np.linspace(0, LENGTH, COUNT)
    fused = plan_weld(tacked, wps(tacks="fuse"), UP)
    skipped = plan_weld(tacked, wps(tacks="skip", tack_length=30e-3), UP)
    assert [bead.kind for bead in fused.beads].count("root") == 1
    first, second = (bead for bead in skipped.beads if bead.kind == "root")
    over = skipped.wps.sequence.overlap
    assert first.s[-1] == pytest.approx(at[4] - 15e-3 + over)
    assert second.s[0] == pytest.approx(at[5] + 15e-3 - over)
    gap = second.s[0] - first.s[-1]
    root = fused.beads[0]
    assert fused.volume - skipped.volume == pytest.approx(gap * root.area[0], rel=1e-6)
    assert [bead.number for bead in skipped.beads][:3] == [1, 1, 2]


@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_files_keep_the_parts_of_a_bead_apart_however_near_they_are(tmp_path: Path) -> None:
    """The example's tack of 40 mm leaves 10 mm without arc: no further than points may stand."""
    plan = plan_weld(plate(tacked=(4,)), wps(tacks="skip"), UP)
    first, second = plan.beads[:2]
    assert [(b.number, b.part) for b in (first, second)] == [(1, 1), (1, 2)]
    assert second.s[0] - first.s[-1] == pytest.approx(LONGEST_STATION_STEP)
    provenance = Provenance.for_file_written_now("job", "j", "mm")
    file = tmp_path / "beads.csv"
    file.write_text(beads_to_csv(plan), encoding="utf-8")
    read = read_beads_csv(file)
    assert [(c.number, len(c.s)) for c in read] == [(b.number, len(b.s)) for b in plan.beads]
    weldx = pytest.importorskip("weldx", reason="the extra tjscan[weldx] is not installed")
    document = plan_document(plan, provenance, "run", plan.wps.name)
    write_plan_as_weldx(tmp_path / "plan.weldx", plan, document, "joint")
    with weldx.WeldxFile(tmp_path / "plan.weldx", mode="r") as made:
        names = made["coordinate_systems"].coordinate_system_names
        assert len(names) == 1 + len(plan.beads)
        assert {"torch, bead 1", "torch, bead 1, part 2"} <= set(names)


def test_where_an_opening_ends_no_bead_has_a_corner() -> None:
    """One that no sampling makes smaller: a plan would look for its step for ever."""
    edges = plate(is_open=True)
    openness = (np.arange(COUNT) < COUNT // 2).astype(float)
    root = replace(edges.root, openness=openness)
    np.testing.assert_array_equal(root.openness_at(root.s), openness)
    slopes = [(root.openness_at(root.s + h) - openness) / h for h in (-1e-6, 1e-6)]
    np.testing.assert_allclose(slopes[0], slopes[1], atol=0.05)
    plan = plan_weld(replace(edges, root=root), wps(), UP)
    for bead in plan.beads:
        chords = np.diff(bead.points, axis=0)
        chords /= np.linalg.norm(chords, axis=1, keepdims=True)
        kinks = np.arccos(np.clip(np.sum(chords[1:] * chords[:-1], axis=1), -1, 1))
        assert kinks.max() <= 1.02 * LARGEST_KINK


def test_after_a_pass_beads_go_on_without_a_root_bead() -> None:
    found = plan_weld(plate(), wps(), UP, after_pass=4)
    assert found.beads[0].number == 5
    assert {bead.kind for bead in found.beads} == {"fill", "cap"}
    assert found.volume == pytest.approx(plan_weld(plate(), wps(), UP).volume, rel=1e-6)


def test_after_a_pass_no_tack_is_fused_or_skipped() -> None:
    """There is no root bead that could: what stands out there is another thing."""
    plan = plan_weld(plate(tacked=(4,)), wps(), UP, after_pass=2)
    provenance = Provenance.for_file_written_now("job", "j", "mm")
    assert plan_document(plan, provenance, "run", plan.wps.name).root.tack_spans_mm == ()


def test_after_a_pass_a_shallow_rest_is_capped_in_one_layer() -> None:
    flat = np.array([(-12e-3, 0.0), (9e-3, 0.0), (9e-3, 3e-3), (-15e-3, 3e-3)])
    x = np.linspace(0, LENGTH, COUNT)
    edges = edges_of(np.stack(np.broadcast_arrays(x[:, None], flat[:, 0], flat[:, 1]), axis=2))
    found = plan_weld(edges, wps(), UP, after_pass=9)
    assert {bead.kind for bead in found.beads} == {"cap"}
    assert {bead.layer for bead in found.beads} == {1}


def test_an_open_root_after_a_pass_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="open root") as error:
        plan_weld(plate(is_open=True), wps(), UP, after_pass=1)
    assert error.value.key == "--after-pass"


def section(condition: str, opening: float = float("nan")) -> MeasuredSection:
    return MeasuredSection(
        index=0,
        station="1",
        azimuth=0.0,
        T_r_g=np.eye(4),
        points=np.zeros((5, 3)),
        covariances=np.zeros((3, 3, 3)),
        measures=np.ones(4),
        measure_covariance=np.eye(4),
        work_angle=0.0,
        rms=0.0,
        conditions=(condition,) if condition else (),
        root_opening=opening,
    )


def test_where_a_section_does_not_show_its_root_those_beside_it_do() -> None:
    sections = [
        section("open root", 4e-3),
        section("tack"),
        section("open root", 5e-3),
        section("root not seen"),
        section(""),
    ]
    s = np.arange(5.0)
    root = root_state_along_sections(sections, s, 4.0, closed=False)
    np.testing.assert_allclose(root.openness, (1.0, 1.0, 1.0, 0.5, 0.0))
    np.testing.assert_array_equal(root.tacked, (False, True, False, False, False))
    assert root.is_open_between(0.0, 2.0)
    assert not root_state_along_sections(sections[3:], s[:2], 1.0, closed=False).is_open_between(
        0, 1
    )


def measured(count: int, conditions: dict[int, str], area: float = 1.0) -> list[MeasuredSection]:
    """Sections 10 mm apart of a groove of 275 mm², with a root of 10 mm."""
    corners = 1e-3 * np.array([(-5, 40, 0), (0, 20, 0), (5, 0, 0), (15, 0, 0), (45, 30, 0)])
    found = []
    for k in range(count):
        origin, along = np.eye(4), np.array((0, 0, 10e-3 * k))
        origin[:3, 3] = (25e-3, 10e-3, 10e-3 * k)
        found.append(
            replace(
                section(conditions.get(k, "")),
                index=k,
                T_r_g=origin,
                points=corners + along,
                covariances=1e-10 * np.tile(np.eye(3), (3, 1, 1)),
                measures=np.array((1.0, 10e-3, 10e-3, area * 275e-6)),
                measure_covariance=1e-14 * np.eye(4),
            )
        )
    return found


def test_a_stretch_without_a_root_is_not_planned() -> None:
    fit_groove_edges(measured(12, {4: "root not seen", 5: "root not seen"}), 31e-3)
    for hidden in (range(4, 8), range(4), range(8, 12), range(12)):
        with pytest.raises(ConfigurationError, match="no root is seen for") as error:
            fit_groove_edges(measured(12, dict.fromkeys(hidden, "root not seen")), 31e-3)
        assert error.value.key == "sections"


@pytest.mark.parametrize("share", [0.6, 0.9, 1.1])
def test_over_a_weld_the_measured_area_is_filled(share: float) -> None:
    """Its surface bulges or sags: the line between its toes is not what bounds the area."""
    s = np.linspace(0, 0.09, 10)
    straight = fit_groove_edges(measured(10, {}), 31e-3)
    welded = dict.fromkeys(range(10), "weld in the groove")
    bulged = fit_groove_edges(measured(10, welded, share), 31e-3)
    areas = [
        map_template_onto(cut_groove_stations(edges, s), 0.0).area for edges in (straight, bulged)
    ]
    np.testing.assert_allclose(areas[1], share * areas[0], rtol=2e-3)


def test_around_a_closed_groove_an_unseen_stretch_counts_across_its_seam() -> None:
    count, radius = 20, 0.16
    sections = []
    for k, one in enumerate(measured(count, dict.fromkeys((18, 19, 0, 1), "root not seen"))):
        angle = 2 * np.pi * k / count
        turned = np.eye(4)
        turned[0, 0] = turned[2, 2] = np.cos(angle)
        turned[0, 2], turned[2, 0] = np.sin(angle), -np.sin(angle)
        flat = one.points * (1, 1, 0) - (radius, 0, 0)
        origin = turned.copy()
        origin[:3, 3] = turned[:3, :3] @ (25e-3 - radius, 10e-3, 0)
        sections.append(replace(one, points=flat @ turned[:3, :3].T, T_r_g=origin))
    assert fit_groove_edges(sections, 0.3).closed
    with pytest.raises(ConfigurationError, match="no root is seen for"):
        fit_groove_edges(sections, 0.2)


def test_a_section_without_area_is_named() -> None:
    sections = measured(8, {})
    sections[3] = replace(sections[3], measures=np.array((1.0, 10e-3, 10e-3, 0.0)))
    with pytest.raises(ConfigurationError, match="section number 4 of the table has no area"):
        fit_groove_edges(sections, 31e-3)
