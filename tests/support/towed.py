"""Towing problems for tests."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.shape.area import DiscObstacle, Floor, Obstacles
from tjscan.towing.shape.cable import Cable
from tjscan.towing.shape.chain import ChainDerivatives, chain_gradient, chain_hessian, place_links
from tjscan.towing.shape.distance import distance_to_obstacle
from tjscan.towing.shape.estimate import CablePull
from tjscan.towing.shape.limits import LimitedProblem, LimitRows, limit_gradients
from tjscan.towing.shape.problem import ShapeProblem
from tjscan.towing.tables import TargetSettings, WeightSettings

YARD = Floor([(0, -5), (2.6, -5), (2.6, 5), (0, 5)])
"""The paper's V-C."""

NOTCHED = Floor(
    [(-1, -5), (3, -5), (3, 1), (2, 1.5), (3, 2), (3, 5), (-1, 5)],
    [[(0.8, -1.2), (1.2, -1.2), (1.2, -0.8), (0.8, -0.8)]],
)
"""A floor with a dent in a wall and a pillar."""

PASSER_BY = DiscObstacle(0.5, 2.0, 0.2, (0.1, -0.05))


PULL = CablePull(
    np.array((2.0, -4.0)), np.array(((300.0, 80.0), (50.0, 900.0))), 49, np.zeros(2), 5e-4
)
"""Of a cable whose last vehicle would stand at the origin."""


def bent_angles(rng: np.random.Generator, links: int = 60, most: float = 0.3) -> Array:
    """Angles of a cable in a few gentle bends."""
    s = np.linspace(0, 1, links)
    waves = rng.normal(size=(3, 1)) * np.sin(rng.uniform(2, 12, (3, 1)) * s + 1)
    return np.asarray(most * waves.sum(axis=0) / 3)


def shape_problem(rng: np.random.Generator, area: Floor = NOTCHED, links: int = 60) -> ShapeProblem:
    """A problem of every term, near a shape with bends."""
    cable = Cable(links=links, root=(0.0, 0.0, 0.2))
    held = np.array([9, 19, 29, 39, 49])
    estimate = bent_angles(rng, links)
    poses = cable.poses(estimate)
    return ShapeProblem(
        cable,
        Obstacles.of_area(area).with_discs([PASSER_BY], 1.0),
        WeightSettings(pull=1.0),
        TargetSettings(),
        estimate,
        np.array([links - 1]),
        poses[-1:] + np.array((0.01, 0.0, 0.0)),
        held,
        poses[held] + np.array((2e-3, 2e-3, 0.0)),
        0.1,
        replace(PULL, place=poses[held[-1], :2]),
    )


def objective_gradient(problem: ShapeProblem, angles: Array) -> Array:
    """Of the objective, shape (N,)."""
    state, gradient = problem.evaluated(angles), np.empty(len(angles))
    parts = ChainDerivatives(state.joint, state.point, state.turn)
    chain_gradient(parts, state.links, problem.cable.link_length, gradient)
    return gradient


def objective_hessian(
    problem: ShapeProblem, angles: Array, multipliers: Array | None = None
) -> Array:
    """Of the objective, shape (N, N), or of the Lagrangian with multipliers, shape (3 E,)."""
    state, hessian = problem.evaluated(angles), np.empty((len(angles), len(angles)))
    if multipliers is not None:
        for link, forces in zip(problem.fixed, multipliers.reshape(-1, 3), strict=True):
            state.point[link, :2] += forces[:2]
    parts = ChainDerivatives(state.joint, state.point, state.turn)
    chain_hessian(parts, state.links, problem.cable.link_length, hessian)
    return hessian


def margin_gradients(limits: LimitedProblem, rows: LimitRows, angles: Array) -> Array:
    """Derivatives of the margins of limits by the angles, shape (R, N)."""
    links, gradients = np.empty((len(angles), 5)), np.empty((len(rows), len(angles)))
    place_links(angles, limits.arrays.root, limits.arrays.length, links)
    limit_gradients(rows, limits.arrays.root, links, gradients)
    return gradients


def obstacle_distances(points: Array, obstacles: Obstacles) -> tuple[Array, Array, Array]:
    """Signed distances (n, K), gradients (n, K, 2) and Hessians (n, K, 3) of points (n, 2)."""
    count = len(obstacles.walls) + len(obstacles.starts) - 1 + len(obstacles.discs)
    found = np.array(
        [[distance_to_obstacle(k, x, y, *obstacles) for k in range(count)] for x, y in points]
    )
    return found[..., 0], found[..., 1:3], found[..., 3:]


def turned(values: Array, angle: float) -> Array:
    """Points, shape (..., 2), turned about the origin."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(values @ np.array(((c, s), (-s, c))))


QUARTER = pi / 2
