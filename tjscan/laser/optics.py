"""Ray casting of a line laser: fan, first hits, view of the detector, mirror images."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from time import sleep
from typing import Final

import numpy as np
import open3d as o3d
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from tjscan.core.devices import LocalDevice
from tjscan.core.errors import LaserFault
from tjscan.core.frames import Array, Mask, readonly_copy, transform_points
from tjscan.laser.deviation import Distortion
from tjscan.laser.faults import FaultRandomStreams, LaserRayHits, SimulatedProfile, apply_faults
from tjscan.laser.line_laser import StreamedProfile
from tjscan.laser.model import LaserModel
from tjscan.laser.profile import Profile

RAY_START_OFFSET: Final = 10e-6
"""Secondary rays start this far above the face, in metres: float32 is good to about 0.1 µm."""

LEAST_RAY_TO_PLANE_COSINE: Final = 1e-3
"""Cosine of incidence below which a plane is too nearly parallel to be met again in float64."""

LEAST_COSINE_IN_RELIEF_SHIFT: Final = 0.2
"""Rays that graze more than this shift over a relief as if they did not."""

LEAST_GHOST_DISTANCE: Final = 0.5e-3
"""A mirror image nearer to the direct point than this melts into it, in metres (assumption)."""


@dataclass(frozen=True, slots=True, eq=False)
class FirstHits:
    """First hits of rays on a surface: distances and normals.

    Parameters
    ----------
    distance : ndarray, shape (n,)
        Along the ray, in metres; infinite if it meets nothing.
    normals : ndarray, shape (n, 3)
        Unit normal of the face hit, on the side the ray came from; zero if there is none.
    """

    distance: Array
    normals: Array


class RaycastSurface:
    """Triangles that light can hit. They need not form a solid.

    Parameters
    ----------
    vertices : array_like, shape (n, 3)
        In frame j, in metres.
    triangles : array_like of int, shape (m, 3)
        Indices of their corners, in either sense of rotation.
    relief : callable, optional
        Gives the height of the true surface over the triangles at points on them, shape (n, 3),
        in frame j: shape (n,), in metres. It is small, and hides nothing.

    Raises
    ------
    ValueError
        If the arrays don't describe at least one triangle.
    """

    def __init__(
        self,
        vertices: ArrayLike,
        triangles: ArrayLike,
        relief: Callable[[Array], Array] | None = None,
    ) -> None:
        v = np.asarray(vertices, dtype=np.float64)
        t = np.asarray(triangles)
        if v.ndim != 2 or v.shape[1] != 3 or not np.isfinite(v).all():
            raise ValueError(f"vertices {v.shape} are not finite points, shape (n, 3)")
        if t.ndim != 2 or t.shape[1] != 3 or len(t) == 0 or t.dtype.kind not in "iu":
            raise ValueError(f"triangles {t.shape} {t.dtype} are not indices, shape (m, 3)")
        if t.min() < 0 or t.max() >= len(v):
            raise ValueError(f"triangles point outside the {len(v)} vertices")
        self.relief = relief
        # Embree computes in float32: keep its numbers small.
        self._centre = 0.5 * (v.min(axis=0) + v.max(axis=0))
        v = v - self._centre
        a, b, c = v[t[:, 0]], v[t[:, 1]], v[t[:, 2]]
        normals = np.cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        self._normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
        self._offsets = np.einsum("ij,ij->i", self._normals, a)
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            o3d.core.Tensor.from_numpy(v.astype(np.float32)),
            o3d.core.Tensor.from_numpy(t.astype(np.uint32)),
        )

    def cast_rays(self, origins: Array, directions: Array) -> FirstHits:
        """Cast rays and give their first hits.

        Embree finds the triangle in float32; the distance is then that to the triangle's
        plane, in float64.

        Parameters
        ----------
        origins, directions : ndarray, shape (n, 3)
            In frame j; directions of length one.
        """
        o = origins - self._centre
        answer = self._scene.cast_rays(_ray_tensor(o, directions), nthreads=1)
        distance = answer["t_hit"].numpy().astype(np.float64)
        hit = np.isfinite(distance)
        face = np.where(hit, answer["primitive_ids"].numpy(), 0).astype(np.intp)
        normals = np.where(hit[:, None], self._normals[face], 0.0)
        cosine = np.einsum("ij,ij->i", normals, directions)
        height = self._offsets[face] - np.einsum("ij,ij->i", normals, o)
        np.divide(height, cosine, out=distance, where=np.abs(cosine) > LEAST_RAY_TO_PLANE_COSINE)
        return FirstHits(distance, np.where(cosine[:, None] > 0, -normals, normals))

    def is_hidden_from(self, points: Array, normals: Array, eye: Array) -> Mask:
        """Whether points on the surface are hidden from an eye, shape (n,).

        Parameters
        ----------
        points, normals : ndarray, shape (n, 3)
            In frame j. An eye behind the plane of its point doesn't see it.
        eye : ndarray, shape (3,)
            In frame j.
        """
        start = points + RAY_START_OFFSET * normals
        way = eye - start
        rays = _ray_tensor(start - self._centre, way)
        taken = self._scene.test_occlusions(rays, tnear=0.0, tfar=1.0, nthreads=1)
        behind = np.einsum("ij,ij->i", way, normals) <= 0
        return np.asarray(taken.numpy() | behind)


def laser_ray_directions(model: LaserModel) -> Array:
    """Unit rays of the columns in frame s, shape (n, 3), by rising x.

    Their tangents are equally spaced: the columns of a pinhole detector whose rows run along
    x_s meet the laser plane in such lines. (Assumption: a real sensor's calibration bends them.)
    """
    edge = np.tan(model.half_angle)
    tangent = np.linspace(-edge, edge, model.columns)
    rays = np.column_stack((tangent, np.zeros_like(tangent), np.ones_like(tangent)))
    return readonly_copy(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def trace_laser_rays(
    surface: RaycastSurface, T_j_s: Array, model: LaserModel, directions_s: Array
) -> LaserRayHits:
    """Trace every column's light to the surface and to the detector.

    Parameters
    ----------
    surface : RaycastSurface
        In frame j.
    T_j_s : ndarray, shape (4, 4)
        Where the sensor is.
    model : LaserModel
        Its optics.
    directions_s : ndarray, shape (n, 3)
        What `laser_ray_directions` gives for `model`.
    """
    R = T_j_s[:3, :3]
    emitter = transform_points(T_j_s, (0.0, 0.0, model.emitter_z))
    rays = directions_s @ R.T
    hits = surface.cast_rays(np.broadcast_to(emitter, rays.shape), rays)
    seen = _is_in_range(hits.distance, directions_s, model)
    ghost = np.full(len(rays), np.nan)

    index = np.flatnonzero(seen)
    points = emitter + hits.distance[index, None] * rays[index]
    distance = hits.distance
    if surface.relief is not None and index.size:
        square = -np.einsum("ij,ij->i", rays[index], hits.normals[index])
        distance = distance.copy()
        distance[index] -= surface.relief(points) / np.maximum(square, LEAST_COSINE_IN_RELIEF_SHIFT)
    if model.occlusion and (model.detector_y, model.detector_z) != (0.0, model.emitter_z):
        detector = transform_points(T_j_s, (0.0, model.detector_y, model.detector_z))
        seen[index] = ~surface.is_hidden_from(points, hits.normals[index], detector)
    if model.ghosts > 0 and index.size:
        ghost[index] = _mirror_image_distances(surface, points, rays[index], hits, index)
        ghost[~(seen & _is_in_range(ghost, directions_s, model))] = np.nan
    return LaserRayHits(directions_s, distance, hits.normals @ R, seen, ghost)


def _mirror_image_distances(
    surface: RaycastSurface, points: Array, rays: Array, hits: FirstHits, index: NDArray[np.intp]
) -> Array:
    """Distances at which faces show the image of what their mirrored rays hit; NaN for nothing.

    Light that a face mirrors onto a second face, and that comes back the same way, seems to
    come from straight on: the image of the second face in the first lies on the same primary
    ray, at the sum of both distances. (Assumption: the first face is large enough for the
    detector to see the whole image in it.)
    """
    normals = hits.normals[index]
    turned = rays - 2.0 * np.einsum("ij,ij->i", rays, normals)[:, None] * normals
    rise = np.einsum("ij,ij->i", turned, normals)
    start = RAY_START_OFFSET / np.maximum(rise, LEAST_RAY_TO_PLANE_COSINE)
    second = start + surface.cast_rays(points + start[:, None] * turned, turned).distance
    image = hits.distance[index] + second
    return np.where(np.isfinite(second) & (second > LEAST_GHOST_DISTANCE), image, np.nan)


def _is_in_range(distance: Array, directions_s: Array, model: LaserModel) -> Mask:
    """Whether points at these distances from the emitter are in the trapezoid, shape (n,)."""
    z = model.emitter_z + distance * directions_s[:, 2]
    return np.asarray((z >= model.near) & (z <= model.far))


def _ray_tensor(origins: Array, directions: Array) -> o3d.core.Tensor:
    """Rays in the layout and precision that Embree takes."""
    rays = np.empty((len(directions), 6), dtype=np.float32)
    rays[:, :3], rays[:, 3:] = origins, directions
    return o3d.core.Tensor.from_numpy(rays)


class SimulatedLaser(LocalDevice):
    """A `LineLaser` on a simulated arm.

    Parameters
    ----------
    surface : RaycastSurface
        What is before the sensor, in frame j.
    pose : callable
        Returns ``T_j_s``, shape (4, 4): the *true* pose of the sensor at this moment.
    model : LaserModel
        Its optics and faults.
    rng : numpy.random.Generator
        Source of all randomness. The same seed gives the same sequence of profiles, and what a
        fault draws in the k-th profile depends on neither the other faults nor earlier views.
    clock : callable
        Gives the time in seconds.
    pass_time : callable, optional
        Lets some seconds pass on it.
    make : int, optional
        Decides how the sensor's own calibration is off, see `LaserModel.linearity`: which sensor
        of its kind it is.
    """

    not_connected = (LaserFault, "the laser is not connected: capture inside a `with` block")

    def __init__(
        self,
        surface: RaycastSurface,
        pose: Callable[[], Array],
        *,
        model: LaserModel,
        rng: Generator,
        clock: Callable[[], float],
        pass_time: Callable[[float], object] = sleep,
        make: int = 0,
    ) -> None:
        self.model = model
        self._surface, self._pose, self._clock = surface, pose, clock
        self._rng, self._pass_time = rng, pass_time
        self._directions_s = laser_ray_directions(model)
        self._distortion = Distortion.draw_in_window(model, make)

    def capture(self) -> Profile:
        """Take one profile from where the sensor is now.

        Raises
        ------
        LaserFault
            Outside a ``with`` block, or if the pose is not one.
        """
        # The time is that of the pose, which is read next: to trace rays takes its time.
        now, points = self._clock(), self.capture_with_origins()
        return Profile(points.x_s, points.z_s, points.intensity, now)

    def check_stream(self, period: float) -> None:
        """Its stamps are true. See `StreamingLaser.check_stream`."""
        self.check_connected()

    def stream(self, period: float) -> Iterator[StreamedProfile]:
        """Take profiles as the arm moves. See `StreamingLaser.stream`."""
        model, due = self.model, self._clock() + period
        while True:
            self._pass_time(max(due - self._clock(), 0.0))
            profile = self.capture()
            due = max(due + period, profile.time)
            delay = model.delay + model.delay_jitter * self._rng.standard_normal()
            self._pass_time(max(delay, 0.0))
            stamp = (profile.time + model.clock_offset) * (1.0 + model.clock_drift)
            yield StreamedProfile(replace(profile, time=stamp))

    def capture_with_origins(self) -> SimulatedProfile:
        """Take one profile with the origin of each point; raises as `capture` does."""
        self.check_connected()
        T_j_s = np.asarray(self._pose(), dtype=np.float64)
        if T_j_s.shape != (4, 4) or not np.isfinite(T_j_s).all():
            raise LaserFault(f"the simulated laser was put at a pose that is not one: {T_j_s}")
        hits = trace_laser_rays(self._surface, T_j_s, self.model, self._directions_s)
        return apply_faults(hits, self.model, FaultRandomStreams.spawn(self._rng), self._distortion)
