"""How well a plan fills the paper's groove, as it was designed: ``python bench/plan.py [--quick]``.

The groove as designed comes from the joint's definition, corner by corner; its volume is that of a
solid (manifold3d). Sections are drawn every 40 mm with errors of 0.03 mm, whole way round; without
``--quick`` the paper's scan is simulated as well, with its default faults.
"""

from __future__ import annotations

import sys
import time
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import replace
from functools import partial
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import manifold3d
import numpy as np
from _table import Row, main

from tjscan.cli import main as tjscan
from tjscan.core.frames import Array
from tjscan.job.wps import read_wps
from tjscan.joint.bevel import groove_sections
from tjscan.joint.file import read_joint
from tjscan.joint.geometry import cylindrical_to_j
from tjscan.planning.edges import GrooveEdges, fit_edges_to_corners, fit_groove_edges
from tjscan.planning.lay import cut_groove
from tjscan.planning.path import chord_error_and_kink, stations_at, template_at
from tjscan.planning.plan import WeldPlan, plan_weld
from tjscan.result.export import sort_sections_by_azimuth
from tjscan.result.table import read_sections_csv

ROOT: Final = Path(__file__).parent.parent
JOINT: Final = read_joint(ROOT / "cad" / "tjoint-600x457.toml")
WPS: Final = read_wps(ROOT / "examples" / "wps.toml")
DOWN: Final = np.array((0.0, 0.0, -1.0))
STEP: Final = 40e-3
SIGMA: Final = 0.03e-3
SEEDS: Final = 5


def designed_corners(phi: Array) -> Array:
    """p3, p4, g and p2 as designed, shape (n, 4, 3): g where wall and the leg's tangent meet."""
    found = groove_sections(JOINT, phi)
    slope = JOINT.leg_surface.slope(phi, found.p4[:, 0])
    rho = found.p2[:, 0]
    g = np.column_stack((rho, found.p4[:, 1] + slope * (rho - found.p4[:, 0])))
    corners = (found.p3, found.p4, g, found.p2)
    return np.stack([cylindrical_to_j(phi, p[:, 0], p[:, 1]) for p in corners], axis=1)


def designed_areas(phi: Array) -> Array:
    """Areas square to the groove, shape (n,), m²: of their vectors, along the corners' way."""
    p, h = designed_corners(phi), 1e-4
    vectors = 0.5 * np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    way = (designed_corners(phi + h) - designed_corners(phi - h)).mean(axis=1)
    return np.asarray(np.abs(np.sum(vectors * way, axis=1)) / np.linalg.norm(way, axis=1))


def designed_volume(n: int = 1440) -> float:
    """Volume of the groove all round, m³, of a solid."""
    p = designed_corners(np.linspace(0, 2 * np.pi, n, endpoint=False))
    at = np.arange(4 * n).reshape(n, 4)
    on = np.roll(at, -1, axis=0)
    faces = []
    for j in range(4):
        a, b, c, d = at[:, j], on[:, j], on[:, (j + 1) % 4], at[:, (j + 1) % 4]
        faces += [np.column_stack((a, b, c)), np.column_stack((a, c, d))]
    mesh = manifold3d.Mesh64(p.reshape(-1, 3), np.concatenate(faces).astype(np.uint64))
    return abs(float(manifold3d.Manifold(mesh).volume()))


def area_errors(edges: GrooveEdges) -> Array:
    """Of the planned section against the designed one, as shares of it."""
    s = np.linspace(0, edges.length, 200)
    stations = stations_at(edges, s)
    p3 = edges.corners(s)[:, 0]
    phi = np.arctan2(p3[:, 1], p3[:, 0])
    planned, truth = template_at(stations, 0.0).area, designed_areas(phi)
    return np.asarray(np.abs(planned / truth - 1))


def drawn_edges(seed: int) -> GrooveEdges:
    """Edges through sections that are drawn all round, with errors in their plane."""
    whole = 2 * np.pi * JOINT.brace_radius
    phi = np.linspace(0, 2 * np.pi, round(whole / STEP), endpoint=False)
    p, rng = designed_corners(phi), np.random.default_rng(seed)
    out = np.column_stack((np.cos(phi), np.sin(phi), 0 * phi))[:, None]
    errors = SIGMA * rng.standard_normal((*p.shape[:2], 2))
    spoiled = p + errors[..., :1] * out + errors[..., 1:] * np.array((0.0, 0.0, 1.0))
    sigmas = np.full(p.shape[:2], np.sqrt(2) * SIGMA)
    return fit_edges_to_corners(spoiled, sigmas, np.full(len(p), 2e-3), 0.13)


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


def fill_error(plan: WeldPlan) -> float:
    """Largest difference of the beads' areas from the section's, as a share of it."""
    s = np.linspace(0, plan.edges.length, 50)
    _, cells = cut_groove(plan.edges, s, plan.zones[0].arrangement, WPS)
    return float(np.abs(cells.areas.sum(axis=1) / cells.template.area - 1).max())


def rows(*, quick: bool) -> list[Row]:
    """Measure."""
    drawn = [drawn_edges(seed) for seed in range(SEEDS)]
    errors = np.array([area_errors(edges) for edges in drawn])
    start = time.process_time()
    plan = plan_weld(drawn[0], WPS, DOWN)
    took = time.process_time() - start
    bare = WPS.model_copy(
        update={
            "bead": replace(WPS.bead, cap_height=0.0),
            "sequence": replace(WPS.sequence, overlap=0.0),
        }
    )
    volume = plan_weld(drawn[0], bare, DOWN).volume / designed_volume() - 1
    count = len(drawn[0].sections)
    beads = [bead.points[:, None] for bead in plan.beads]
    kink = max(chord_error_and_kink(p, 0.5 * (p[1:] + p[:-1]))[1] for p in beads)
    found = [
        Row(f"area, drawn sections, {SEEDS} seeds: mean", 100 * float(errors.mean()), 1, "%"),
        Row(f"area, drawn sections, {SEEDS} seeds: largest", 100 * float(errors.max()), 3, "%"),
        Row("volume of the whole groove against a solid", 100 * abs(volume), 0.5, "%"),
        Row("beads against their section", 100 * fill_error(plan), 0.1, "%"),
        Row("samples inside speed, heat and area", share_inside(plan), 100, "%", at_least=100),
        Row("beads", len(plan.beads), 17, "", at_least=13),
        Row("kink between two chords", float(np.degrees(kink)), 2, "°"),
        Row("whole joint planned, CPU", took, 5, "s"),
        Row("of that, a section", 1e3 * took / count, 5, "ms"),
    ]
    if not quick:
        errors = area_errors(scanned_edges())
        found += [
            Row("area, the paper's scan simulated: mean", 100 * float(errors.mean()), 1, "%"),
            Row("area, the paper's scan simulated: largest", 100 * float(errors.max()), 3, "%"),
        ]
    return found


if __name__ == "__main__":
    words = sys.argv[1:]
    measure = partial(rows, quick="--quick" in words)
    sys.exit(main("Weld plan", measure, [word for word in words if word != "--quick"]))
