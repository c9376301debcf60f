"""How far an arm and what it carries are from everything else, by Pinocchio and coal.

The arm's bodies are the collision geometry of its URDF. URDF has no capsule: a cylinder there is
given round ends, which is on the safe side, and spheres that these ends hold are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.frames import Array, inverse_pose
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import Box, Capsule, Cylinder, Solid, SolidShape

NAME_OF_ALL_TOOL_SOLIDS: Final = "tool"
"""Name for every solid the arm carries, in pairs that are ignored."""

SCANNED_GROOVE_NAME: Final = "scanned groove"
"""What a refusal calls the surface that has been measured."""

IGNORED_COLLISION_PAIRS: Final = (
    ("forearm_link", "wrist_3_link"),
    ("wrist_1_link", "wrist_3_link"),
    ("wrist_1_link", NAME_OF_ALL_TOOL_SOLIDS),
    ("link_4", "link_6"),
)
"""Pairs of an arm of `robot/models` whose capsules overlap though the arm's own bodies, which are
slimmer there, pass each other; an assumption about what is carried, too."""


@dataclass(frozen=True, slots=True)
class BodyPair:
    """A pair of bodies that must keep apart.

    Parameters
    ----------
    moving : str
        A link or a solid that the arm carries.
    other : str
        What it must not touch.
    own : bool
        Whether both belong to the arm.
    """

    moving: str
    other: str
    own: bool


@dataclass(frozen=True, slots=True, eq=False)
class _CollisionBody:
    """A body as Pinocchio knows it, with what it is to the pairs."""

    geometry: Any
    name: str
    ignored_as: str

    @property
    def joint(self) -> int:
        return int(self.geometry.parentJoint)


class CollisionModel:
    """Distances between an arm, what it carries, what is around it, and itself.

    Pinocchio's scratch memory is in it: one thread at a time.

    Parameters
    ----------
    kinematics : Kinematics
        The arm.
    solids : sequence of Solid
        What is around it, in frame b.
    tool : sequence of Solid
        What it carries, in frame f.
    self_collision : bool, optional
        Whether the arm and what it carries are kept from each other.
    ignored : iterable of (str, str), optional
        Pairs of links, or a link and ``tool``, that are never looked at, beside
        `IGNORED_COLLISION_PAIRS`.

    Attributes
    ----------
    pairs : tuple of BodyPair
        What `distances` returns, in its order.

    Raises
    ------
    ConfigurationError
        If a mesh that the URDF names can't be read.
    """

    pairs: tuple[BodyPair, ...]

    def __init__(
        self,
        kinematics: Kinematics,
        solids: Sequence[Solid] = (),
        tool: Sequence[Solid] = (),
        *,
        self_collision: bool = True,
        ignored: Iterable[tuple[str, str]] = (),
    ) -> None:
        self._kinematics = kinematics
        self._data = kinematics.model.createData()
        self._ignored = {frozenset(pair) for pair in (*IGNORED_COLLISION_PAIRS, *ignored)}
        self._self_collision = self_collision
        self._arm = [
            *_link_bodies(kinematics),
            *(_carried_body(kinematics, solid) for solid in tool),
        ]
        self._around = [_fixed_body(kinematics, solid) for solid in solids]
        self._build_geometry(self._around)

    def distances(self, q: Array) -> Array:
        """Distances of `pairs` in metres, shape (p,), for joint angles, shape (n,), in radians.

        Below zero two bodies overlap, about that deep.
        """
        pin.computeDistances(self._kinematics.model, self._data, self._geometry, self._results, q)
        return np.array([result.min_distance for result in self._results.distanceResults])

    @cached_property
    def reach(self) -> Array:
        """Metres per radian of each joint by which each pair comes nearer at most, shape (p, n)."""
        reach = [self._farthest_point_per_joint(*pair) for pair in self._apart]
        return np.array(reach).reshape(len(reach), self._kinematics.model.nq)

    def make_nearness_check(self, least: Array) -> Callable[[Array], BodyPair | None]:
        """Make a check whether bodies are nearer than allowed; far quicker than `distances`.

        Parameters
        ----------
        least : ndarray, shape (p,)
            Least distance of each of `pairs`, metres; a pair of -inf is not looked at.

        Returns
        -------
        callable
            For joint angles, shape (n,), a pair that is nearer, or None. It knows nothing of a
            surface that is given later.
        """
        model, geometry = self._kinematics.model, self._geometry
        results = pin.GeometryData(geometry)
        for i, distance in enumerate(least):
            if np.isfinite(distance):
                results.collisionRequests[i].security_margin = float(distance)
            else:
                results.deactivateCollisionPair(i)
        pairs = self.pairs

        def check(q: Array) -> BodyPair | None:
            pin.forwardKinematics(model, self._data, q)
            pin.updateGeometryPlacements(model, self._data, geometry, results)
            if not pin.computeCollisions(geometry, results, True):
                return None
            found = (i for i, one in enumerate(results.collisionResults) if one.isCollision())
            return pairs[next(found)]

        return check

    def set_measured_surface(self, vertices_b: Array, triangles: NDArray[np.int64]) -> None:
        """Keep clear of a surface that has been measured, in place of the last one given.

        Parameters
        ----------
        vertices_b : ndarray, shape (k, 3)
            Metres, frame b.
        triangles : ndarray, shape (m, 3)
            Numbers of the vertices.
        """
        mesh = coal.BVHModelOBBRSS()
        mesh.beginModel(len(triangles), len(vertices_b))
        mesh.addVertices(np.asarray(vertices_b, dtype=float))
        mesh.addTriangles(np.asarray(triangles, dtype=np.int64))
        mesh.endModel()
        T_root_b = pin.SE3(self._kinematics.T_root_b)
        groove = pin.GeometryObject(SCANNED_GROOVE_NAME, 0, T_root_b, mesh)
        self._build_geometry(
            [*self._around, _CollisionBody(groove, SCANNED_GROOVE_NAME, SCANNED_GROOVE_NAME)]
        )

    def _build_geometry(self, around: Sequence[_CollisionBody]) -> None:
        self._geometry = geometry = pin.GeometryModel()
        bodies = [*self._arm, *around]
        for body in bodies:
            geometry.addGeometryObject(body.geometry)
        pairs, self._apart = [], list[tuple[_CollisionBody, _CollisionBody]]()
        for i, first in enumerate(self._arm):
            for k, second in enumerate(bodies[i + 1 :], start=i + 1):
                own = k < len(self._arm)
                kept_apart = not own or self._must_keep_apart(first, second)
                if first.joint == second.joint or not kept_apart:
                    continue
                geometry.addCollisionPair(pin.CollisionPair(i, k))
                # What is carried comes last: it is the clearer name of the two.
                moving, other = (second, first) if own else (first, second)
                pairs.append(BodyPair(moving.name, other.name, own))
                self._apart.append((first, second))
        self.pairs = tuple(pairs)
        self.__dict__.pop("reach", None)
        self._results = pin.GeometryData(geometry)

    def _must_keep_apart(self, first: _CollisionBody, second: _CollisionBody) -> bool:
        """Whether two bodies of the arm are looked at: not those that one joint connects."""
        ignored = frozenset((first.ignored_as, second.ignored_as)) in self._ignored
        return self._self_collision and abs(first.joint - second.joint) > 1 and not ignored

    def _farthest_point_per_joint(self, first: _CollisionBody, second: _CollisionBody) -> Array:
        """Farthest that a point of the outer body can be from each joint between the two."""
        inner, outer = sorted((first, second), key=lambda body: body.joint)
        shape = outer.geometry.geometry
        shape.computeLocalAABB()
        centre = outer.geometry.placement.act(shape.aabb_center)
        farthest = float(np.linalg.norm(centre) + shape.aabb_radius)
        model = self._kinematics.model
        reach = np.zeros(model.nq)
        for joint in range(outer.joint, inner.joint, -1):
            reach[joint - 1] = farthest
            farthest += float(np.linalg.norm(model.jointPlacements[joint].translation))
        return reach


@dataclass(frozen=True, slots=True, eq=False)
class PlacedBody:
    """A body that is somewhere.

    Parameters
    ----------
    name : str
        As of `BodyPair`.
    shape : coal.CollisionGeometry
        What it is.
    T : ndarray, shape (4, 4)
        Its pose.
    """

    name: str
    shape: Any
    T: Array

    @classmethod
    def of_solid(cls, solid: Solid) -> PlacedBody:
        """A solid of a job."""
        return cls(solid.name, _collision_geometry(solid.shape), solid.T)

    @property
    def farthest(self) -> float:
        """Metres from the origin that no point of it is beyond."""
        self.shape.computeLocalAABB()
        centre = self.T[:3, :3] @ self.shape.aabb_center + self.T[:3, 3]
        return float(np.linalg.norm(centre) + self.shape.aabb_radius)

    def distance(self, other: PlacedBody, T: Array) -> float:
        """Metres from another body that T moves; below zero they overlap, about that deep."""
        placed = [coal.Transform3s(T[:3, :3], T[:3, 3]) for T in (self.T, T @ other.T)]
        asked, result = coal.DistanceRequest(), coal.DistanceResult()
        return float(coal.distance(self.shape, placed[0], other.shape, placed[1], asked, result))


def bodies_of_arm(kinematics: Kinematics, q: Array, tool: Sequence[Solid]) -> list[PlacedBody]:
    """Bodies of an arm and what its flange carries, in frame b, at joint angles in radians."""
    data, T_b_root = kinematics.model.createData(), inverse_pose(kinematics.T_root_b)
    pin.forwardKinematics(kinematics.model, data, q)
    bodies = [*_link_bodies(kinematics), *(_carried_body(kinematics, solid) for solid in tool)]
    return [
        PlacedBody(
            body.name,
            body.geometry.geometry,
            T_b_root @ (data.oMi[body.joint] * body.geometry.placement).homogeneous,
        )
        for body in bodies
    ]


def check_ignored_links(kinematics: Kinematics, pairs: Iterable[tuple[str, str]]) -> None:
    """Check that pairs to ignore name links of the arm, or ``tool``.

    Raises
    ------
    ConfigurationError
        With the nearest name there is.
    """
    known = (*kinematics.link_names, NAME_OF_ALL_TOOL_SOLIDS)
    for name in (name for pair in pairs for name in pair if name not in known):
        raise ConfigurationError(f"no link {name!r}; did you mean: {nearest_word(name, known)}?")


@lru_cache(maxsize=8)
def _link_bodies(kinematics: Kinematics) -> tuple[_CollisionBody, ...]:
    model, urdf = kinematics.model, kinematics.urdf
    try:
        kind = pin.GeometryType.COLLISION
        found = pin.buildGeomFromUrdf(model, str(urdf), kind, package_dirs=str(urdf.parent))
    except (ValueError, RuntimeError) as error:
        message = f"its collision geometry can't be read: {error}"
        raise ConfigurationError(message, file=urdf) from None
    objects = [_capsule_of_cylinder(one) for one in found.geometryObjects]
    capsules = [one for one in objects if isinstance(one.geometry, coal.Capsule)]
    bodies = []
    for one in objects:
        if any(_is_end_of_capsule(one, capsule) for capsule in capsules):
            continue
        name = str(model.frames[one.parentFrame].name)
        bodies.append(_CollisionBody(one, name, name))
    return tuple(bodies)


def _capsule_of_cylinder(one: Any) -> Any:
    """A geometry object, its cylinder given round ends."""
    shape = one.geometry
    if not isinstance(shape, coal.Cylinder):
        return one
    capsule = coal.Capsule(shape.radius, 2 * shape.halfLength)
    return pin.GeometryObject(one.name, one.parentJoint, one.parentFrame, one.placement, capsule)


def _is_end_of_capsule(one: Any, capsule: Any) -> bool:
    """Whether a geometry object is a sphere that a capsule of the same joint holds."""
    if not isinstance(one.geometry, coal.Sphere) or one.parentJoint != capsule.parentJoint:
        return False
    x, y, z = capsule.placement.actInv(one.placement.translation)
    aside = float(np.hypot(np.hypot(x, y), max(abs(z) - capsule.geometry.halfLength, 0.0)))
    return bool(aside + one.geometry.radius <= capsule.geometry.radius + 1e-6)


def _carried_body(kinematics: Kinematics, solid: Solid) -> _CollisionBody:
    flange, shape = kinematics.flange, _collision_geometry(solid.shape)
    frame = kinematics.model.frames[flange]
    placement = frame.placement * pin.SE3(np.asarray(solid.T))
    geometry = pin.GeometryObject(solid.name, frame.parentJoint, flange, placement, shape)
    return _CollisionBody(geometry, solid.name, NAME_OF_ALL_TOOL_SOLIDS)


def _fixed_body(kinematics: Kinematics, solid: Solid) -> _CollisionBody:
    placement = pin.SE3(kinematics.T_root_b @ solid.T)
    geometry = pin.GeometryObject(solid.name, 0, placement, _collision_geometry(solid.shape))
    return _CollisionBody(geometry, solid.name, solid.name)


def _collision_geometry(shape: SolidShape) -> Any:
    if isinstance(shape, Box):
        return coal.Box(*shape.size)
    kinds = {Cylinder: coal.Cylinder, Capsule: coal.Capsule}
    return kinds[type(shape)](shape.radius, shape.length)
