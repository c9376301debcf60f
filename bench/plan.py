"""How well a plan fills the paper's groove, as it was designed: ``python bench/plan.py [--quick]``.

The groove as designed comes from the joint's definition, corner by corner, its solid from
manifold3d. Sections are drawn every 40 mm with errors of 0.03 mm, whole way round. Without
``--quick`` the paper's scan is simulated as well, with its default faults, and 1,000 grooves of
the 300 joints of ``examples/joints-study.toml`` are planned: each joint whole, the rest arcs of
eight sections from anywhere.
"""

from __future__ import annotations

import sys
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import replace
from functools import cache, partial
from io import StringIO
from itertools import cycle, islice
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import process_time
from typing import Final

import manifold3d
import numpy as np
import shapely
from _designed_grooves import (
    designed_areas,
    designed_corners,
    designed_rims,
    drawn_edges,
    many_joints,
    ring_solid,
)
from _second_reader import count_outside, samples_of_program, samples_of_table
from _stopwatch import Stopwatch
from _table import Row, main
from _weld_programs import find_reaches, follow_program

from tjscan.cli import main as tjscan
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.joint.file import read_joint
from tjscan.planning.document import beads_to_csv
from tjscan.planning.edges import GrooveEdges, fit_groove_edges
from tjscan.planning.lay import ArrangedGroove
from tjscan.planning.path import chord_error_and_kink, cut_groove_stations, map_template_onto
from tjscan.planning.plan import WeldPlan, plan_weld
from tjscan.planning.urscript import path_to_urscript
from tjscan.planning.wps import WeldingProcedure, read_wps
from tjscan.result.shapes import sort_sections_by_azimuth
from tjscan.result.table import read_sections_csv

ROOT: Final = Path(__file__).parent.parent
JOINT: Final = read_joint(ROOT / "cad" / "tjoint-600x457.toml")
WPS: Final = read_wps(ROOT / "examples" / "wps.toml")
DOWN: Final = np.array((0.0, 0.0, -1.0))
STEP: Final = 40e-3
SIGMA: Final = 0.03e-3
SEEDS: Final = 5
NEES_SEEDS: Final = 40
GROOVES: Final = 1000
SECTIONS: Final = 39
"""Of a whole joint of any size: steps of 0.08 of the brace's diameter."""


def whole_way(step: float = STEP) -> Array:
    """Azimuths of sections a step apart."""
    whole = 2 * np.pi * JOINT.brace_radius
    return np.linspace(0, 2 * np.pi, round(whole / step), endpoint=False)


@cache
def designed_areas_round() -> tuple[Array, Array]:
    """Azimuths of sections all round the joint, and their areas as designed, square to the groove.

    Square to the groove through sections without errors: random errors turn a plane by a
    milliradian, and an area changes by the square of that.
    """
    edges = drawn_edges(JOINT, whole_way(), 1e-9, 0)
    stations = cut_groove_stations(edges, np.linspace(0, edges.length, 361)[:-1])
    p3 = edges.corners(stations.s)[:, 0]
    return np.arctan2(p3[:, 1], p3[:, 0]), designed_areas(JOINT, stations)


def area_errors(edges: GrooveEdges, s: Array) -> Array:
    """Of the planned section against the designed one, as shares of it."""
    p3 = edges.corners(s)[:, 0]
    designed = np.interp(np.arctan2(p3[:, 1], p3[:, 0]), *designed_areas_round(), period=2 * np.pi)
    return map_template_onto(cut_groove_stations(edges, s), 0.0).area / designed - 1


def other_joints_area_errors(stride: int) -> list[float]:
    """The largest of every so many of the study's joints, against their own surfaces; no errors."""
    found = []
    for joint in islice(many_joints(JOINT), 3, None, stride):
        edges = drawn_edges(joint, np.linspace(0, 2 * np.pi, SECTIONS, endpoint=False), 1e-9, 0)
        stations = cut_groove_stations(edges, np.linspace(0, edges.length, 73)[:-1])
        designed = designed_areas(joint, stations)
        worst = float(np.abs(map_template_onto(stations, 0.0).area / designed - 1).max())
        print(f"{joint.name}: {100 * worst:.2f} %", file=sys.stderr)
        found.append(worst)
    return found


def many_area_errors(edges: GrooveEdges) -> Array:
    """Their sizes at 200 places."""
    return np.abs(area_errors(edges, np.linspace(0, edges.length, 200)))


def nees(step: float) -> tuple[float, float]:
    """Mean square of area errors in stated standard deviations, at sections and between them."""
    at: list[float] = []
    between: list[float] = []
    for seed in range(NEES_SEEDS):
        edges = drawn_edges(JOINT, whole_way(step) + 0.01 * seed, SIGMA, seed)
        middles = edges.sections[:-1] + 0.5 * np.diff(edges.sections)
        for s, found in ((edges.sections, at), (middles, between)):
            ratio = area_errors(edges, s) / edges.relative_area_sigma(s)
            found.append(float(np.mean(ratio**2)))
    return float(np.mean(at)), float(np.mean(between))


def scanned_edges() -> GrooveEdges:
    """Edges through the sections of the paper's scan, simulated."""
    with TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        with suppress(SystemExit), redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            tjscan(["scan", str(ROOT / "examples" / "paper.toml"), "--out", str(run)])
        sections = sort_sections_by_azimuth(read_sections_csv(run / "sections.csv"))
    return fit_groove_edges(sections, 0.13)


def share_inside(plan: WeldPlan) -> float:
    """Share of all samples that are inside speed, heat and bead area, per cent."""
    inside = []
    for bead in plan.beads:
        good = np.ones(len(bead.s), dtype=bool)
        for values, (low, high) in (
            (bead.speed, WPS.arc.travel_speed),
            (bead.heat, WPS.arc.heat_input),
            (bead.area, getattr(WPS.bead, f"{bead.kind}_area")),
        ):
            good &= (values >= low) & (values <= high)
        inside.append(good)
    return 100 * float(np.concatenate(inside).mean())


TIGHTENED: Final = (
    ("heat_input_kJ_mm = [0.5, 2.0]", "heat_input_kJ_mm = [0.5, 1.3]"),
    ("travel_speed_mm_min = [240.0, 420.0]", "travel_speed_mm_min = [240.0, 340.0]"),
    ('"PC", "PF", "PG"]', '"PC", "PF"]'),
    ("crater_feed = 1.0", "crater_feed = 0.4"),
    ("weave_limit_mm = 14.0", "weave_limit_mm = 9.0"),
    (
        """name = "PG"
wire_feed_m_min = [6.0, 10.0]""",
        """name = "PG"
wire_feed_m_min = [6.0, 7.0]""",
    ),
)
"""Windows of the example and tighter ones, that a plan is partly outside of."""


def samples_outside() -> tuple[int, int]:
    """Samples of plans outside a window of their WPS, by a second reader, and those not named."""
    text = (ROOT / "examples" / "wps.toml").read_text(encoding="utf-8")
    found = []
    for before, after in (("", ""), *TIGHTENED):
        if before not in text:
            raise RuntimeError(f"the example has no {before}")
        with TemporaryDirectory() as folder:
            file = Path(folder) / "wps.toml"
            changed = text.replace(before, after, 1) if before else text
            file.write_text(changed, encoding="utf-8")
            plan = plan_weld(drawn_edges(JOINT, whole_way(), SIGMA, 0), read_wps(file), DOWN)
        table = beads_to_csv(plan)
        found.append(count_outside(samples_of_table(changed, table), plan.findings))
    return sum(one[0] for one in found), sum(one[1] for one in found)


def overlaps_and_gaps(plan: WeldPlan) -> float:
    """What beads cover twice or leave of a section, the largest share of it; by shapely."""
    s = np.linspace(0, plan.edges.length, 50)
    _, cells = ArrangedGroove(plan.edges, plan.zones[0].arrangement, plan.wps).cut(s)
    worst = 0.0
    for i, corners in enumerate(cells.template.corners):
        beads = [shapely.Polygon(outline) for outline in cells.outlines(i)]
        union = shapely.union_all(beads)
        twice = sum(bead.area for bead in beads) - union.area
        left = shapely.Polygon(corners).difference(union).area
        worst = max(worst, (twice + left) / float(cells.template.area[i]))
    return worst


def without_cap_and_overlap() -> WeldingProcedure:
    """The WPS for what the groove alone holds."""
    return WPS.model_copy(
        update={
            "bead": replace(WPS.bead, cap_height=0.0),
            "sequence": replace(WPS.sequence, overlap=0.0),
            "start_stop": None,
        }
    )


def volumes(edges: GrooveEdges) -> tuple[float, float]:
    """Of the whole groove: planned against designed, and what solids of beads miss or exceed."""
    designed = ring_solid(designed_rims(JOINT, np.linspace(0, 2 * np.pi, 720, endpoint=False), 10))
    plan = plan_weld(edges, without_cap_and_overlap(), DOWN)
    s = np.linspace(0, edges.length, 720, endpoint=False)
    stations, cells = ArrangedGroove(edges, plan.zones[0].arrangement, plan.wps).cut(s)
    quads = [stations.points_to_space(cells.quadrilaterals(k)) for k in range(len(cells.counts))]
    solids = [ring_solid(quad[:, j]) for quad in quads for j in range(quad.shape[1])]
    filled = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    whole = designed.volume()
    wrong = (designed - filled).volume() + (filled - designed).volume()
    return abs(plan.volume / whole - 1), wrong / whole


def slowest_plan() -> WeldPlan:
    """The plan that takes longest of those the WPS allows: with the lowest wire feed that fits."""
    low, high = WPS.arc.wire_feed
    for feed in np.linspace(low, high, 81)[:-1]:
        arc = replace(WPS.arc, wire_feed=(feed, feed + 1e-6))
        one = WPS.model_copy(update={"arc": arc, "position": (), "start_stop": None})
        with suppress(ConfigurationError):
            plan = plan_weld(drawn_edges(JOINT, whole_way(), SIGMA, 0), one, DOWN)
            if len(plan.zones) == 1 and all(f.key == "sequence.positions" for f in plan.findings):
                return plan
    raise RuntimeError("no wire feed of the WPS fits")


def many_grooves(count: int) -> tuple[float, float]:
    """Shares of grooves, per cent, that are planned, and that are planned or refused with key."""
    joints, rng = list(many_joints(JOINT)), np.random.default_rng(0)
    chosen = joints[:: max(1, len(joints) // count)]
    planned = answered = 0
    for i, joint in enumerate(islice(cycle(chosen), count)):
        phi = np.linspace(0, 2 * np.pi, SECTIONS, endpoint=False)
        if i >= len(chosen):
            phi = rng.uniform(0, 2 * np.pi) + phi[:8]
        try:
            plan_weld(drawn_edges(joint, phi, SIGMA, i), WPS, DOWN)
            planned += 1
        except ConfigurationError as refused:
            answered += refused.key is not None
            print(f"{joint.name}: {refused}", file=sys.stderr)
    return 100 * planned / count, 100 * (planned + answered) / count


def reach_rows(edges: GrooveEdges, *, quick: bool) -> list[Row]:
    """What two stations reach, and the program of one of them on the loopback controller."""
    start = process_time()
    reaches, plan = find_reaches(edges, designed_corners(JOINT, whole_way()), WPS, DOWN)
    took = process_time() - start
    stretches = [one.stretch for one in reaches]
    turns = [
        0.0 if one is None else 360 * (one.end - one.begin) / edges.length for one in stretches
    ]
    reached = {bead.station for bead in plan.beads}
    way = reaches[0].lead_torch(plan)
    text = (ROOT / "examples" / "wps.toml").read_text(encoding="utf-8")
    written = samples_of_program(
        text, path_to_urscript(way, WPS.model_copy(update={"weave": None}), 0, arc=True)
    )
    _, unnamed = count_outside(written, plan.findings)
    ways = [replace(way, beads=way.beads[:1])] if quick else [way]
    followed = [follow_program(reaches[0], one, WPS) for one in ways]
    return [
        Row("reach of two stations, CPU", took, 30, "s"),
        Row("groove that each reaches, at least", min(turns), 360, "°", at_least=180),
        Row("stations that weld", len(reached), 2, "", at_least=2),
        Row(
            "program: beads with the arc on", sum(one.beads for one in followed), 13, "", at_least=1
        ),
        Row("program without weaves: steps at a speed outside the WPS, not named", unnamed, 0, ""),
        Row("program: off the path", 1e3 * max(one.off_path for one in followed), 0.2, "mm"),
        Row("program: off the speed", 100 * max(one.off_speed for one in followed), 2, "%"),
        Row(
            "program: arc on and off, off the ends",
            1e3 * max(one.off_ends for one in followed),
            0.2,
            "mm",
        ),
    ]


def rows(*, quick: bool) -> list[Row]:
    """Measure."""
    drawn = [drawn_edges(JOINT, whole_way(), SIGMA, seed) for seed in range(SEEDS)]
    exact = many_area_errors(drawn_edges(JOINT, whole_way(), 1e-9, 0))
    errors = np.array([many_area_errors(edges) for edges in drawn])
    others = other_joints_area_errors(43 if quick else 7)
    watch = Stopwatch()
    for seed in range(SEEDS):
        with watch:
            plan = plan_weld(drawn_edges(JOINT, whole_way(), SIGMA, seed), WPS, DOWN)
    count = len(plan.edges.sections)
    volume, wrong = volumes(drawn[0])
    at, between = nees(STEP)
    saved = 1 - plan.arc_time / slowest_plan().arc_time
    beads = [bead.points[:, None] for bead in plan.beads]
    kink = max(chord_error_and_kink(p, 0.5 * (p[1:] + p[:-1]))[1] for p in beads)
    outside, unnamed = samples_outside()
    grooves = 30 if quick else GROOVES
    done, answered = many_grooves(grooves)
    found = [
        Row(
            "area, sections without errors, all round: largest", 100 * float(exact.max()), 0.3, "%"
        ),
        Row(f"the same of {len(others)} other joints: median", 100 * median(others), 0.3, "%"),
        Row("… of the worst", 100 * max(others), 0.3, "%"),
        Row(f"area, drawn sections, {SEEDS} seeds: mean", 100 * float(errors.mean()), 1, "%"),
        Row(f"area, drawn sections, {SEEDS} seeds: largest", 100 * float(errors.max()), 3, "%"),
        Row(f"stated sigma of the area, NEES, {NEES_SEEDS} seeds", at, 1.5, "", at_least=0.7),
        Row("the same halfway between sections", between, 1.5, "", at_least=0.7),
        Row("volume of the whole groove against a solid", 100 * volume, 0.5, "%"),
        Row("solids of the beads: missing and beyond", 100 * wrong, 1, "%"),
        Row("beads overlap or leave gaps in a section", 100 * overlaps_and_gaps(plan), 0.1, "%"),
        Row(
            "samples outside a tightened WPS, found by a second reader",
            outside,
            1e9,
            "",
            at_least=1,
        ),
        Row("of these not named", unnamed, 0, ""),
        Row("samples inside speed, heat and area", share_inside(plan), 100, "%", at_least=100),
        Row("beads", len(plan.beads), 17, "", at_least=13),
        Row("kink between two chords", float(np.degrees(kink)), 2, "°"),
        Row(f"{grooves} grooves planned", done, 100, "%", at_least=99),
        Row(f"{grooves} grooves planned or refused with key", answered, 100, "%", at_least=100),
        Row("arc time saved against the worst plan allowed", 100 * saved, 100, "%", at_least=33),
        watch.row(f"whole joint planned, {count} sections", median, 5 * count),
    ]
    found += reach_rows(drawn[0], quick=quick)
    if not quick:
        errors = many_area_errors(scanned_edges())
        found += [
            Row("area, the paper's scan simulated: mean", 100 * float(errors.mean()), 1, "%"),
            Row("area, the paper's scan simulated: largest", 100 * float(errors.max()), 3, "%"),
        ]
    return found


if __name__ == "__main__":
    words = sys.argv[1:]
    measure = partial(rows, quick="--quick" in words)
    sys.exit(main("Weld plan", measure, [word for word in words if word != "--quick"]))
