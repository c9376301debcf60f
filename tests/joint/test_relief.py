"""Mill scale and scallops on the simulated joint, seen by the simulated laser."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tjscan.core.frames import Array, pose
from tjscan.joint.definition import (
    NO_IMPERFECTIONS,
    BevelAsCut,
    Imperfections,
    JointDefinition,
    MillScale,
    Ovality,
)
from tjscan.joint.edges import JointGrooveSections
from tjscan.joint.file import read_joint
from tjscan.joint.geometry import cylindrical_to_j
from tjscan.joint.relief import make_relief_height_function
from tjscan.laser.model import LaserModel
from tjscan.laser.optics import RaycastSurface, laser_ray_directions, trace_laser_rays

CAD = Path(__file__).parents[2] / "cad"
SCALE = MillScale(thickness=0.3e-3, coverage=0.35, patch=0.012)
SCALLOPS = BevelAsCut(scallop_depth=0.3e-3, scallop_length=4e-3)


@cache
def joint(imperfections: Imperfections = NO_IMPERFECTIONS) -> JointDefinition:
    return replace(read_joint(CAD / "tjoint-600x457.toml"), imperfections=imperfections)


def on_tubes(d: JointDefinition, n: int) -> tuple[Array, Array]:
    """Points of the wall and of the leg, each (n, 3)."""
    rng = np.random.default_rng(1)
    phi = rng.uniform(0, 2 * np.pi, n)
    z = rng.uniform(0.4, 0.6, n)
    rho = rng.uniform(0.24, 0.28, n)
    return cylindrical_to_j(phi, d.brace_wall_radius(phi, z), z), d.leg_surface.points_j(phi, rho)


def test_a_smooth_joint_has_no_relief() -> None:
    assert make_relief_height_function(joint()) is None


def test_scale_covers_the_stated_share_with_the_stated_thickness() -> None:
    d = joint(replace(NO_IMPERFECTIONS, scale=SCALE, leg_ovality=Ovality(ovality=0.01)))
    relief = make_relief_height_function(d)
    assert relief is not None
    for points in on_tubes(d, 20_000):
        heights = relief(points)
        assert heights.min() == 0
        assert heights.max() == pytest.approx(SCALE.thickness)
        assert np.mean(heights > 0.5 * SCALE.thickness) == pytest.approx(SCALE.coverage, abs=0.06)


def test_scale_lies_on_the_tubes_alone_and_the_seed_places_it() -> None:
    d = joint(replace(NO_IMPERFECTIONS, scale=SCALE))
    relief, other = (
        make_relief_height_function(d),
        make_relief_height_function(joint(replace(NO_IMPERFECTIONS, scale=replace(SCALE, seed=1)))),
    )
    assert relief is not None
    assert other is not None
    phi = np.linspace(0, 6, 2000)
    s = JointGrooveSections(d, phi)
    middle = 0.5 * (s.p2 + s.p3)
    assert not relief(cylindrical_to_j(phi, middle[:, 0], middle[:, 1])).any()
    wall, _ = on_tubes(d, 2000)
    assert (relief(wall) != other(wall)).any()


def test_scallops_rise_and_fall_along_the_bevel() -> None:
    relief = make_relief_height_function(joint(replace(NO_IMPERFECTIONS, bevel=SCALLOPS)))
    assert relief is not None
    s = JointGrooveSections(joint(), np.array([0.7]))
    length = float(np.linalg.norm(s.p2 - s.p3))
    up = np.arange(0.01e-3, length, 0.01e-3)
    rz = s.p3 + up[:, None] * (s.p2 - s.p3) / length
    heights = relief(cylindrical_to_j(np.full_like(up, 0.7), rz[:, 0], rz[:, 1]))
    assert np.ptp(heights) == pytest.approx(SCALLOPS.scallop_depth, rel=0.01)
    crests = np.flatnonzero((heights[1:-1] > heights[:-2]) & (heights[1:-1] >= heights[2:])) + 1
    np.testing.assert_allclose(np.diff(up[crests]), SCALLOPS.scallop_length, atol=0.02e-3)
    assert not relief(joint().leg_surface.points_j(np.linspace(0, 6, 99), 0.27)).any()


def test_a_relief_is_seen_at_its_height() -> None:
    """A plate with a step: the laser sees it as high as it is, straight on and aslant."""
    x, y = 0.1, 0.1
    vertices = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    step = RaycastSurface(vertices, triangles, lambda p: np.where(p[:, 0] > 0, 0.5e-3, 0.0))
    model = LaserModel.without_faults()
    for lean in (0.0, 0.5):
        c, s = np.cos(lean), np.sin(lean)
        R = np.array([[c, 0, s], [0, -1, 0], [s, 0, -c]])
        T_j_s = pose(R, -0.24 * R[:, 2])
        hits = trace_laser_rays(step, T_j_s, model, laser_ray_directions(model))
        points = (
            T_j_s[:3, 3]
            + ((0, 0, model.emitter_z) + hits.distance[:, None] * hits.directions_s) @ R.T
        )
        inner = hits.seen & (np.abs(points[:, 0]) > 1e-3)
        expected = np.where(points[:, 0] > 0, 0.5e-3, 0.0)
        np.testing.assert_allclose(points[inner, 2], expected[inner], atol=1e-7)
