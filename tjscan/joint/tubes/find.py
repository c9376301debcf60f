"""Leg and brace found in a cloud about which nothing else is known.

A normal comes from a triple of neighbouring points, also if the cloud consists of scan lines,
whose neighbours across are far. Two points with normals make a cylinder; many are tried, those
that explain most points are refined and the best is kept. The second tube is sought in the points
that the first one leaves over.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import KDTree

from tjscan.core.errors import TubesNotFound
from tjscan.core.frames import Array, Mask
from tjscan.joint.tubes.cylinder import Cylinder, fit_cylinder, refine_cylinder
from tjscan.joint.tubes.fit import LEAST_AXES_ANGLE, FittedTubes

VOXELS_ALONG_DIAGONAL: Final = 70
"""Voxels along the cloud's diagonal; one point of each is used."""

NORMAL_NEIGHBOURS: Final = 24
CYLINDER_TRIALS: Final = 4000
REFINED_CYLINDER_TRIALS: Final = 24
"""How many of the best trials are refined."""

MOST_REFINED_TUBE_POINTS: Final = 30_000
"""Points that the tubes are settled on in the end; more would not make ten numbers surer."""

TUBE_TRIAL_REACH: Final = 0.02
"""Share of the radius within which points count for a trial."""

ON_TUBE_DISTANCE: Final = 1.5e-3
"""Metres from a tube within which points lie on it, in the end: allows for a tube out of round."""

TUBE_LOSS_SCALE: Final = 0.2 * ON_TUBE_DISTANCE
"""Metres from a tube beyond which points lose weight while it is sought."""

LEAST_TUBE_SHARE: Final = 0.08
"""Of the cloud, that must be on either tube."""

LEAST_TUBE_RADIUS: Final = 0.02
MOST_TUBE_RADIUS: Final = 5.0
"""Metres."""


def find_tubes_in_cloud(points: Array, *, seed: int = 0) -> FittedTubes:
    """Find brace and leg in a point cloud.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Metres, in any frame: of the groove's surroundings, more than a quarter round.
    seed : int
        Of the random trials.

    Returns
    -------
    Tubes
        The leg is the tube of the larger radius. The covariance takes the points for independent,
        which those of a scan are not: for these see `fit_tubes_to_walls`.

    Raises
    ------
    TubesNotFound
        If the cloud holds no two tubes that cross, or they are equally large.
    """
    import open3d as o3d

    points = np.array(points, dtype=float)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 100:
        raise TubesNotFound(f"{len(points)} points are too few to find two tubes in")
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    voxels = np.asarray(cloud.voxel_down_sample(diagonal / VOXELS_ALONG_DIAGONAL).points)
    # Means of voxels lie off curved walls; their nearest points lie on them.
    thin = points[np.unique(KDTree(points).query(voxels)[1])]
    rng = np.random.default_rng(seed)
    first = _best_cylinder(thin, thin, rng, None)
    rest = thin[np.abs(first.signed_distances(thin)) > 2 * ON_TUBE_DISTANCE]
    second = _best_cylinder(rest, thin, rng, first)
    # Each again on the points that are its own.
    apart = np.abs(np.stack((first.signed_distances(thin), second.signed_distances(thin))))
    on, off = apart < ON_TUBE_DISTANCE, apart > 3 * ON_TUBE_DISTANCE
    first, _ = fit_cylinder(first, thin[on[0] & off[1]], TUBE_LOSS_SCALE)
    second, _ = fit_cylinder(second, thin[on[1] & off[0]], TUBE_LOSS_SCALE)
    chosen = points[:: max(1, len(points) // MOST_REFINED_TUBE_POINTS)]
    first, second = refine_cylinder(first, chosen), refine_cylinder(second, chosen)
    brace, leg = sorted((first, second), key=lambda tube: tube.radius)
    if leg.radius - brace.radius < ON_TUBE_DISTANCE:
        message = f"both tubes are {2e3 * leg.radius:.1f} mm wide: which one is the leg stays open"
        raise TubesNotFound(message)
    return _tubes_with_covariance(brace, leg, thin)


def _best_cylinder(
    points: Array, everything: Array, rng: np.random.Generator, other: Cylinder | None
) -> Cylinder:
    """The cylinder that explains most points, refined."""
    which = "first" if other is None else "second"
    if len(points) < LEAST_TUBE_SHARE * len(everything) or len(points) <= NORMAL_NEIGHBOURS:
        raise TubesNotFound(f"nothing is left of the cloud in which a {which} tube could be")
    centres, axes, radii = _cylinders_through_pairs(points, rng)
    if other is not None:
        crossing = _crosses_tube(axes, other)
        centres, axes, radii = centres[crossing], axes[crossing], radii[crossing]
    if not len(radii):
        raise TubesNotFound(f"no {which} tube is to be seen in the cloud")
    sample = points[rng.permutation(len(points))[:400]]
    q = sample[None] - centres[:, None]
    along = np.einsum("tpk,tk->tp", q, axes)
    off = np.sqrt(np.maximum(np.einsum("tpk,tpk->tp", q, q) - along**2, 0)) - radii[:, None]
    votes = np.maximum(1 - (off / (TUBE_TRIAL_REACH * radii[:, None])) ** 2, 0).sum(axis=1)
    best, most = None, 0
    for trial in np.argsort(-votes, kind="stable")[:REFINED_CYLINDER_TRIALS]:
        rough = Cylinder(centres[trial], axes[trial], float(radii[trial]))
        near = points[np.abs(rough.signed_distances(points)) < 2 * TUBE_TRIAL_REACH * rough.radius]
        refined, held = fit_cylinder(rough, near, TUBE_LOSS_SCALE)
        held = held and (other is None or bool(_crosses_tube(refined.axis, other)))
        on_tube = np.abs(refined.signed_distances(points)) < ON_TUBE_DISTANCE
        supporters = int(on_tube.sum()) if held else 0
        if supporters > most and LEAST_TUBE_RADIUS < refined.radius < MOST_TUBE_RADIUS:
            best, most = refined, supporters
    if best is None or most < LEAST_TUBE_SHARE * len(everything):
        share = 100 * most / len(everything)
        raise TubesNotFound(
            f"the {which} tube holds {share:.0f} % of the cloud, {100 * LEAST_TUBE_SHARE:.0f} % "
            "are needed: cut the cloud down to the joint, or scan more of it"
        )
    return best


def _cylinders_through_pairs(points: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Cylinders through pairs of places: points on the axes, axes and radii."""
    around = np.asarray(KDTree(points).query(points, k=NORMAL_NEIGHBOURS + 1)[1])
    place = rng.integers(len(points), size=2 * CYLINDER_TRIALS)
    pick = 1 + rng.permuted(np.tile(np.arange(NORMAL_NEIGHBOURS), (len(place), 1)), axis=1)[:, :2]
    triple = points[np.column_stack((place, np.take_along_axis(around[place], pick, axis=1)))]
    normals = np.cross(triple[:, 1] - triple[:, 0], triple[:, 2] - triple[:, 0])
    size = np.linalg.norm(normals, axis=1)
    spread = np.linalg.norm(triple[:, 1:] - triple[:, :1], axis=2).prod(axis=1)
    p, q = triple.mean(axis=1).reshape(2, CYLINDER_TRIALS, 3)
    normals /= np.maximum(size, 1e-300)[:, None]
    n, m = normals.reshape(2, CYLINDER_TRIALS, 3)
    stout = (size > 0.2 * spread).reshape(2, CYLINDER_TRIALS).all(axis=0)
    axes = np.cross(n, m)
    sine = np.linalg.norm(axes, axis=1)
    axes /= np.maximum(sine, 1e-300)[:, None]
    # p - r n and q - s m lie on the axis: seen along it they are one point, r and s alike.
    d = p - q
    d -= np.einsum("tk,tk->t", d, axes)[:, None] * axes
    cosine = np.einsum("tk,tk->t", n, m)
    dn, dm = np.einsum("tk,tk->t", d, n), np.einsum("tk,tk->t", d, m)
    with np.errstate(divide="ignore", invalid="ignore"):
        r = (dn - cosine * dm) / sine**2
        s = (cosine * dn - dm) / sine**2
    good = stout & (sine > 0.2) & (np.abs(np.abs(r) - np.abs(s)) < 0.1 * np.abs(r)) & (r * s > 0)
    good &= (np.abs(r) > LEAST_TUBE_RADIUS) & (np.abs(r) < MOST_TUBE_RADIUS)
    r, p, n = r[good], p[good], n[good]
    return p - r[:, None] * n, axes[good], np.abs(r)


def _crosses_tube(axes: Array, other: Cylinder) -> Mask:
    """Whether axes, shape (..., 3), are far from parallel to the axis of another tube."""
    return np.asarray(np.abs(axes @ other.axis) < np.cos(LEAST_AXES_ANGLE))


def _tubes_with_covariance(brace: Cylinder, leg: Cylinder, points: Array) -> FittedTubes:
    """Both tubes with the covariance that independent points give."""
    covariance, total, count = np.zeros((10, 10)), 0.0, 0
    for tube, at in ((brace, slice(0, 5)), (leg, slice(5, 10))):
        off = tube.signed_distances(points)
        on = np.abs(off) < ON_TUBE_DISTANCE
        jacobian = tube.jacobian(points[on])
        square = float(off[on] @ off[on])
        covariance[at, at] = np.linalg.inv(jacobian.T @ jacobian) * square / max(on.sum() - 5, 1)
        total, count = total + square, count + int(on.sum())
    return FittedTubes(brace, leg, covariance, 1.0, float(np.sqrt(total / count)))
