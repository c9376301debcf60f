"""A small world of drawn grooves for the groove's tests: a 2-D outline, a fan of rays, noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from tjscan.core.frames import Array
from tjscan.laser.profile import Profile

MM = 1e-3
COLUMNS = 640
HALF_FIELD = 0.21
"""Tangent of half the fan's angle: 50 mm at 240 mm."""


def turned(v: Array, angle: float) -> Array:
    """Vectors (..., 2) of the x-z plane turned by `angle`."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(v @ np.array([[c, s], [-s, c]]))


@dataclass(frozen=True)
class Groove:
    """A drawn groove; lengths in metres, angles in radians.

    `opening` is the angle between bevel and leg, `ridge` the turn from wall to bevel, `share`
    the part of the turn from bevel to leg that is made at p3, `roll` a turn of everything (0:
    the sensor looks along the middle of the opening). `curvature` is that of the leg (one over
    metres, positive: it falls away from the sensor).
    """

    opening: float = 1.05
    ridge: float = 0.75
    share: float = 0.5
    bevel: float = 0.034
    root: float = 0.006
    roll: float = 0.0
    curvature: float = 0.0
    wall_curvature: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    distance: float = 0.240
    length: float = 0.12

    @property
    def directions(self) -> Array:
        """Directions of wall, bevel, root and leg, from wall to leg, shape (4, 2)."""
        valley = np.pi - self.opening
        bevel = self.roll - valley / 2
        angles = [bevel + self.ridge, bevel, bevel + self.share * valley, bevel + valley]
        return np.array([turned(np.array([-1.0, 0.0]), a) for a in angles])

    @property
    def corners(self) -> Array:
        """p2, p3, p4, shape (3, 2); the middle of p2 and p4 lies before the sensor."""
        d = self.directions
        p2 = np.zeros(2)
        p3 = p2 + self.bevel * d[1]
        p4 = p3 + self.root * d[2]
        origin = (p2 + p4) / 2
        centre = np.array([self.shift[0], self.distance + self.shift[1]])
        return np.asarray(np.array([p2, p3, p4]) - origin + centre)

    def outline(self) -> list[Array]:
        """The four sides as polylines, each shape (n, 2), from wall to leg."""
        p2, p3, p4 = self.corners
        d = self.directions
        return [
            arc(p2, -d[0], -self.wall_curvature, self.length)[::-1],
            np.array([p2, p3]),
            np.array([p3, p4]),
            arc(p4, d[3], self.curvature, self.length),
        ]


def arc(start: Array, direction: Array, curvature: float, length: float) -> Array:
    """Points along a circle from `start`, shape (n, 2); it bends to the right of `direction`."""
    if curvature == 0:
        return np.array([start, start + length * direction])
    s = np.linspace(0, length, 400)[:, None]
    right = np.array([direction[1], -direction[0]])
    a = s * abs(curvature)
    sagitta = np.sign(curvature) * (1 - np.cos(a)) * right
    return np.asarray(start + (np.sin(a) * direction + sagitta) / abs(curvature))


def cast(sides: list[Array], starts: Array, rays: Array) -> tuple[Array, NDArray[np.intp], Array]:
    """Range of the first hit of unit rays (m, 2), which side was hit, and its unit tangent.

    NaN and -1 where nothing is hit.
    """
    a = np.concatenate([s[:-1] for s in sides])
    e = np.concatenate([np.diff(s, axis=0) for s in sides])
    side = np.concatenate([np.full(len(s) - 1, k) for k, s in enumerate(sides)])
    w = a - starts[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        den = rays[:, :1] * e[:, 1] - rays[:, 1:] * e[:, 0]
        t = (w[..., 0] * e[:, 1] - w[..., 1] * e[:, 0]) / den
        u = (w[..., 0] * rays[:, 1:] - w[..., 1] * rays[:, :1]) / den
    t = np.where((t > 1e-9) & (u >= -1e-12) & (u <= 1 + 1e-12), t, np.inf)
    first = t.argmin(axis=1)
    r = t[np.arange(len(rays)), first]
    tangent = e[first] / np.linalg.norm(e[first], axis=1)[:, None]
    hit = np.isfinite(r)
    return np.where(hit, r, np.nan), np.where(hit, side[first], -1), tangent


@dataclass(frozen=True)
class Noise:
    """What spoils a drawn profile; `sigma` in metres, shares between 0 and 1."""

    sigma: float = 0.03 * MM
    correlation: float = 3.0
    ghosts: float = 0.0
    missing: float = 0.0
    flyers: float = 0.0


def correlated(rng: np.random.Generator, n: int, sigma: float, correlation: float) -> Array:
    """Gaussian noise of standard deviation `sigma`, smoothed over about `correlation` columns."""
    if correlation <= 0:
        return sigma * rng.standard_normal(n)
    width = correlation / 2
    white = rng.standard_normal(n + 200)
    smooth = gaussian_filter1d(white, width)[100:-100]
    kernel = gaussian_filter1d(np.eye(1, 201, 100)[0], width)
    return np.asarray(sigma * smooth / np.sqrt((kernel**2).sum()))


def draw(groove: Groove, noise: Noise, seed: int = 0, columns: int = COLUMNS) -> Profile:
    """The profile of a drawn groove seen from (0, 0), columns in the order of growing x_s."""
    return seen(groove.outline(), noise, seed, columns)


def seen(sides: list[Array], noise: Noise, seed: int = 0, columns: int = COLUMNS) -> Profile:
    """The profile of any outline."""
    rng = np.random.default_rng(seed)
    u = np.linspace(-HALF_FIELD, HALF_FIELD, columns)
    rays = np.column_stack((u, np.ones(columns)))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    clean, side, tangent = cast(sides, np.zeros((columns, 2)), rays)
    r = clean.copy()
    if noise.ghosts:
        # Light mirrored by one face onto another seems to come from straight on.
        points = clean[:, None] * rays
        turned_rays = 2 * (rays * tangent).sum(axis=1)[:, None] * tangent - rays
        second, _, _ = cast(sides, np.where(side[:, None] < 0, 0.0, points), turned_rays)
        ghost = clean + np.where(
            (side >= 0) & (second > 0.5 * MM) & (second < 0.04), second, np.nan
        )
        possible = np.flatnonzero(np.isfinite(ghost))
        count = int(min(noise.ghosts * columns, 0.6 * len(possible)))
        spoiled = np.zeros(columns, dtype=bool)
        while spoiled.sum() < count:
            k, run = int(rng.integers(len(possible))), int(rng.integers(4, 31))
            spoiled[possible[k : k + min(run, count)]] = True
        r = np.where(spoiled, ghost, r)
    for corner in np.flatnonzero(np.diff(side))[: None if noise.flyers else 0]:
        for k in (corner, corner + 1):
            if rng.random() < noise.flyers:
                r[k] += rng.normal() * 0.5 * MM
    r = r + correlated(rng, columns, noise.sigma, noise.correlation)
    gone = 0
    while gone < noise.missing * columns:
        first, n = int(rng.integers(columns)), int(rng.integers(1, 13))
        r[first : first + n] = np.nan
        gone += n
    p = r[:, None] * rays
    return Profile(p[:, 0], p[:, 1])


def pulled_in(
    profile: Profile, groove: Groove, pull: float, fade: Callable[[Array], Array]
) -> Profile:
    """What light between the faces of the notch makes of a profile.

    Each point moves towards the sensor by `pull` metres times what `fade` gives for its distance
    from the root's face.
    """
    x, z = profile.x_s, profile.z_s
    _, p3, p4 = groove.corners
    points, along = np.column_stack((x, z)), p4 - p3
    share = np.clip((points - p3) @ along / (along @ along), 0, 1)
    away = np.linalg.norm(points - p3 - share[:, None] * along, axis=1)
    scale = 1 - pull * fade(away) / z
    return Profile(x * scale, z * scale)


def raised_cosine(away: Array, reach: float = 4 * MM) -> Array:
    """One at zero, nothing from `reach` on."""
    return np.asarray(np.where(away < reach, 0.5 + 0.5 * np.cos(np.pi * away / reach), 0.0))
