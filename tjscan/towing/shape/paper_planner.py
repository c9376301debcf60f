"""The paper's two problems as printed, solved as there by SLSQP, to be compared with.

Suzuki et al. (2022), IV: exact poses (1)-(4), nearest obstacle and no sign of its distance (7), a
kink in the change (8), no limit for bends, clearances or speeds. What the paper
leaves open is closed as for the planner (`docs/towing.md`); the code shares nothing with that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
import scipy  # its parts are loaded at first use
from numpy.typing import NDArray

from tjscan.core.frames import Array
from tjscan.towing.shape.area import Floor, Obstacles
from tjscan.towing.shape.cable import Cable, TowingTeam
from tjscan.towing.shape.plan import PlanInputs, PlannerSettings, PlanTerms, TowingPlan
from tjscan.towing.shape.planner import TowingPlanner
from tjscan.towing.shape.problem import OBSTACLE_LOSS

SLSQP_ITERATIONS: Final = 200
"""Of SLSQP; the paper names none."""

Scalar = Callable[[Array], tuple[float, Array]]
Vector = Callable[[Array], tuple[Array, Array]]


class PaperPlanner(TowingPlanner):
    """The paper's method, but for how a tow begins, which it does not state: as the planner's.

    Parameters
    ----------
    cable : Cable
    team : TowingTeam
    area : Floor
    settings : PlannerSettings, optional
        Weights and targets of it; its limits, its trust in poses and its pace are not the paper's.
    """

    def __init__(
        self, cable: Cable, team: TowingTeam, area: Floor, settings: PlannerSettings | None = None
    ) -> None:
        settings = settings or PlannerSettings()
        unpaced = replace(settings.weights, pace=0.0)
        super().__init__(cable, team, area, replace(settings, weights=unpaced))

    def plan(self, inputs: PlanInputs) -> TowingPlan:
        """Estimate by (1), then optimise by (5). See `plan.ShapePlanner`.

        The paper knows no period and no vehicle that stopped.
        """
        last = inputs.last or self.starts(inputs.welder_pose, inputs.obstacles)[0]
        held, known = np.array(self.team.held_links), np.isfinite(inputs.poses).all(axis=1)
        known_poses = self._pose_constraint(held[known], inputs.poses[known])
        estimate, count, failed = minimise_with_slsqp(
            lambda a: (float(a @ a), 2 * a), known_poses, last.estimate
        )
        floor = self._floor.with_discs(inputs.obstacles, 0.0)
        at_welder = self._pose_constraint(held[-1:], inputs.welder_pose[None])
        angles, more, failed_too = minimise_with_slsqp(
            lambda a: self.objective(a, estimate, floor)[1:], at_welder, estimate
        )
        off = float(np.abs(at_welder(angles)[0]).max())
        terms, _, _ = self.objective(angles, estimate, floor)
        halt = "" if off < 1e-3 else f"SLSQP found no shape: {failed_too or failed}"
        poses, steps = self.cable.poses(angles), count + more
        return TowingPlan(
            estimate, angles, poses, poses[held], terms, off, iterations=steps, halt=halt
        )

    def objective(
        self, angles: Array, estimate: Array, floor: Obstacles
    ) -> tuple[PlanTerms, float, Array]:
        """Terms of (5)-(8) over N, their sum, and its gradient, shape (N,)."""
        weights, targets, n = self.settings.weights, self.settings.targets, self.cable.links
        bend, by_bend = _rising_loss(angles**2, targets.bending**2)
        change, by_change = _rising_loss(np.abs(angles - estimate)[1:], targets.change)
        near, by_near = _loss_of_nearest(self.cable.poses(angles)[:, :2], floor, targets.distance)
        terms = PlanTerms(
            weights.bending / n * float(bend.sum()),
            weights.distance / n * float(near.sum()),
            weights.change / n * float(change.sum()),
        )
        gradient = weights.bending * by_bend * 2 * angles
        gradient[1:] += weights.change * by_change * np.sign(angles - estimate)[1:]
        motions = self._motions(angles)[:, :2]
        gradient += weights.distance * np.einsum("kx,kxj->j", by_near, motions)
        return terms, terms.total, gradient / n

    def _motions(self, angles: Array) -> Array:
        """How links' ends go, and headings turn, as joints turn: shape (N links, 3, N joints)."""
        line = self.cable.line(angles)
        x, y = np.moveaxis(line[1:, None] - line[:-1], 2, 0)
        return np.tril((-y, x, np.ones_like(x))).swapaxes(0, 1)

    def _pose_constraint(self, links: NDArray[np.int64], poses: Array) -> Vector:
        """(2)-(4), (10)-(12) in absolute form: where links are less where they must be."""

        def off(angles: Array) -> tuple[Array, Array]:
            values = self.cable.poses(angles)[links] - poses
            values[:, 2] = (values[:, 2] + np.pi) % (2 * np.pi) - np.pi
            return values.ravel(), self._motions(angles)[links].reshape(-1, len(angles))

        return off


def minimise_with_slsqp(f: Scalar, constraint: Vector, start: Array) -> tuple[Array, int, str]:
    """Solution of SLSQP, its iterations, and why it failed if it did."""
    found = scipy.optimize.minimize(  # type: ignore[call-overload]
        f,
        start,
        jac=True,
        method="SLSQP",
        constraints={
            "type": "eq",
            "fun": lambda a: constraint(a)[0],
            "jac": lambda a: constraint(a)[1],
        },
        options={"maxiter": SLSQP_ITERATIONS, "ftol": 1e-8},
    )
    return found.x, int(found.nit), "" if found.success else str(found.message)


def _rising_loss(f: Array, target: float) -> tuple[Array, Array]:
    """(9) from 0 to 1, and its derivative."""
    value, slope = np.zeros_like(f), np.zeros_like(f)
    for share, steep in OBSTACLE_LOSS:
        t, zero = np.tanh(steep / target * (f - target)), np.tanh(steep)
        value += share * (t + zero) / (1 + zero)
        slope += share * steep / target * (1 - t**2) / (1 + zero)
    return value, slope


def _loss_of_nearest(points: Array, floor: Obstacles, target: float) -> tuple[Array, Array]:
    """(7): ρ_d of the distance to the nearest wall, edge or disc; and by the points, (N, 2)."""
    place = [points - (points @ wall[:2] - wall[2])[:, None] * wall[:2] for wall in floor.walls]
    for polygon in floor.polygons:
        for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            place.append(a + t[:, None] * (b - a))
    for disc in floor.discs:
        away = points - disc[:2]
        place.append(disc[:2] + disc[4] * away / np.linalg.norm(away, axis=1, keepdims=True))
    apart = points[None] - np.array(place)
    distance = np.linalg.norm(apart, axis=2)
    nearest = distance.argmin(axis=0), np.arange(len(points))
    d = distance[nearest]
    value, slope = np.zeros_like(d), np.zeros_like(d)
    for share, steep in OBSTACLE_LOSS:
        t = np.tanh(steep / target * (d - target))
        value += share * (1 - t) / 2
        slope -= share * steep / target * (1 - t**2) / 2
    return value, slope[:, None] * apart[nearest] / np.maximum(d, 1e-9)[:, None]
