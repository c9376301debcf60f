"""The plant behind towing vehicles: MuJoCo simulates the cable, and forces push the vehicles.

Cable: Suzuki et al. (2022), III-A: links with joints of three degrees of freedom between them, a
spring and a damper each. Vehicles are bodies in the plane that forces push.
"""

from __future__ import annotations

from math import ceil
from typing import Any, Final

import mujoco
import numpy as np

from tjscan.core.errors import VehicleFault
from tjscan.core.frames import Array
from tjscan.vehicle.cable.model import CableModel, TowingWorldModel
from tjscan.vehicle.pad_plant import GRAVITY_M_S2

TIME_STEP: Final = 0.005
"""Seconds of one step; docs/vehicles.md has what others give."""

DIVERGENCE_WARNINGS: Final = tuple(
    getattr(mujoco.mjtWarning, f"mjWARN_BAD{what}") for what in ("QPOS", "QVEL", "QACC")
)

# Warnings become errors below; left alone, MuJoCo writes them to a file where the program runs.
mujoco.set_mju_user_warning(lambda message: None)


class CablePlant:
    """What truly moves: a cable that lies on the floor, and the n vehicles that hold it.

    The cable starts in a given shape in the plane, at rest. The same forces give the same motion.

    Parameters
    ----------
    world : TowingWorldModel
    angles : ndarray, shape (N,)
        Of the joints at first, radians.
    step : float, optional
        Seconds.
    """

    def __init__(self, world: TowingWorldModel, angles: Array, *, step: float = TIME_STEP) -> None:
        self.cable, self.step = world.cable, step
        model: Any = specify_scene(world, step).compile()
        self._model, self._data = model, mujoco.MjData(model)
        vehicles = [model.joint(f"x {m}") for m in range(len(self.cable.held))]
        three = np.arange(3)
        self._at = np.concatenate([joint.qposadr[0] + three for joint in vehicles])
        self._dof = np.concatenate([joint.dofadr[0] + three for joint in vehicles])
        self._links = np.array([model.body(f"link {i}").id for i in range(self.cable.links)])
        self._floor = model.geom("floor").id
        self._passers_by = [
            int(model.body(f"passer-by {i + 1}").mocapid[0]) for i in range(len(world.passers_by))
        ]
        self._lay_cable(angles)

    def _lay_cable(self, angles: Array) -> None:
        headings, points = self.cable.headings(angles), self.cable.points(angles)
        held = np.array(self.cable.held)
        data = self._data
        for i, angle in enumerate(np.asarray(angles, float)):
            at = self._model.joint(f"joint {i}").qposadr[0]
            data.qpos[at : at + 4] = (np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2))
        data.qpos[self._at] = np.column_stack((points[held + 1], headings[held])).ravel()
        mujoco.mj_forward(self._model, data)

    @property
    def poses(self) -> Array:
        """Of the vehicles: x, y in metres and the heading in radians, not wrapped, (n, 3)."""
        return np.array(self._data.qpos[self._at]).reshape(-1, 3)

    @property
    def speeds(self) -> Array:
        """Of the vehicles in frame w, m/s and rad/s, shape (n, 3)."""
        return np.array(self._data.qvel[self._dof]).reshape(-1, 3)

    @property
    def headings(self) -> Array:
        """Directions of the links in the plane, radians, not wrapped, shape (N,)."""
        mujoco.mj_kinematics(self._model, self._data)
        along = self._data.xmat[self._links].reshape(-1, 3, 3)[:, :, 0]
        return np.unwrap(np.arctan2(along[:, 1], along[:, 0]))

    @property
    def points(self) -> Array:
        """The root and the far end of each link, metres, shape (N + 1, 3)."""
        mujoco.mj_kinematics(self._model, self._data)
        near = self._data.xpos[self._links]
        tip = near[-1] + self.cable.link_length * self._data.xmat[self._links[-1]][[0, 3, 6]]
        return np.vstack((near, tip))

    @property
    def touching_pairs(self) -> set[tuple[str, str]]:
        """What touches what, but for the floor, by name; a pair in alphabetical order."""
        pairs = self._data.contact.geom
        geom = self._model.geom
        return {
            (min(a, b), max(a, b))
            for a, b in (
                (geom(first).name, geom(second).name)
                for first, second in pairs[(pairs != self._floor).all(axis=1)].tolist()
            )
        }

    @property
    def energy(self) -> float:
        """Of motion, of the bends, and of height, J."""
        mujoco.mj_energyPos(self._model, self._data)
        mujoco.mj_energyVel(self._model, self._data)
        return float(self._data.energy.sum())

    def place_passer_by(self, which: int, at: Array) -> None:
        """Put a passer-by somewhere: x and y, metres, shape (2,)."""
        self._data.mocap_pos[self._passers_by[which], :2] = at

    def advance(self, forces: Array) -> None:
        """Go on by one step.

        Parameters
        ----------
        forces : ndarray, shape (n, 3)
            That push each vehicle, and the moment about its origin, in frame w: newton, N m.

        Raises
        ------
        VehicleFault
            If the simulation diverges; its state is worth nothing then.
        """
        self._data.qfrc_applied[self._dof] = np.ravel(forces)
        mujoco.mj_step(self._model, self._data)
        if any(self._data.warning[kind].number for kind in DIVERGENCE_WARNINGS):
            raise VehicleFault(
                "the simulation of the cable diverged. Forces or speeds are beyond what it can "
                "follow; take a smaller step."
            )


FRICTION_IMPEDANCE_RATIO: Final = 1000.0
"""How much harder a contact is along the floor than into it, MuJoCo's ``impratio``. Friction is
Coulomb's but for a creep that this leaves; docs/vehicles.md has how much."""

FLOOR_CONTACT_TIME_CONSTANT: Final = 0.02
FLOOR_CONTACT_IMPEDANCE: Final = (0.5, 0.5, 0.001, 0.5, 2.0)
"""``solref`` and ``solimp`` of the floor: soft enough that links rest on it. On a harder one
they hop, friction works by jerks, and forces are wrong by half."""

CABLE_HOLD_TIME_CONSTANT: Final = 0.01
CABLE_HOLD_IMPEDANCE: Final = (0.999, 0.999, 0.001, 0.5, 2.0)
"""Of what holds a cable's end to the next vehicle."""

CABLE_HOLD_MASS_SHARE: Final = 0.1
"""Share of a vehicle's mass in the welded end: a weld is as soft as what it holds is light."""

WALL_THICKNESS: Final = 0.02
WALL_HEIGHT: Final = 0.3
"""Of walls and passers-by, metres."""

FLOOR_BIT, WALL_BIT, PASSER_BY_BIT, LINK_BIT, VEHICLE_BIT = (1 << bit for bit in range(5))
"""Kinds of things that may touch, as MuJoCo's masks distinguish them."""

Geom: Final = mujoco.mjtGeom


def specify_scene(world: TowingWorldModel, step: float) -> Any:
    """MuJoCo's specification, an ``MjSpec``, of a world whose cable is straight.

    Each vehicle is the root of the links behind it, up to the link of the next vehicle, which a
    weld holds there. So MuJoCo's matrices stay sparse, and the time grows with the links and not
    with their cube.

    Everything that may touch is a geom with a name that a user understands; ``x 0`` is the first
    of the three joints of the first vehicle, ``joint 7`` that of the link 7, ``free end`` of a root
    that nothing holds.

    Parameters
    ----------
    world : TowingWorldModel
    step : float
        Of the simulation, seconds.
    """
    spec: Any = mujoco.MjSpec()
    option = spec.option
    option.timestep, option.gravity = step, (0.0, 0.0, -GRAVITY_M_S2)
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, FRICTION_IMPEDANCE_RATIO
    spec.worldbody.add_geom(
        name="floor", type=Geom.mjGEOM_PLANE, size=(1, 1, 1), contype=FLOOR_BIT, conaffinity=0
    )
    _add_walls(spec.worldbody, world.walls)
    for number, passer_by in enumerate(world.passers_by, 1):
        name = f"passer-by {number}"
        spec.worldbody.add_body(name=name, mocap=True).add_geom(
            name=name,
            type=Geom.mjGEOM_CYLINDER,
            size=(passer_by.radius, WALL_HEIGHT / 2, 0),
            pos=(0, 0, WALL_HEIGHT / 2),
            contype=PASSER_BY_BIT,
            conaffinity=0,
        )
    _add_cable(spec, world)
    _add_vehicles(spec, world)
    return spec


def _add_walls(ground: Any, walls: tuple[Array, ...]) -> None:
    for which, polygon in enumerate(walls):
        corners = np.asarray(polygon, float)
        following = np.roll(corners, -1, axis=0)
        area = 0.5 * np.sum(corners[:, 0] * following[:, 1] - following[:, 0] * corners[:, 1])
        # The outline's walls are outside it, a pillar's walls inside it.
        side = np.sign(area) * (1.0 if which == 0 else -1.0)
        for edge, (start, end) in enumerate(zip(corners, following, strict=True), 1):
            along = end - start
            length, turn = float(np.hypot(*along)), np.arctan2(along[1], along[0]) / 2
            outward = side * np.array((along[1], -along[0])) / length
            x, y = (start + end) / 2 + outward * WALL_THICKNESS / 2
            ground.add_geom(
                name=f"wall {edge}" if which == 0 else f"pillar {which}, side {edge}",
                type=Geom.mjGEOM_BOX,
                size=(length / 2, WALL_THICKNESS / 2, WALL_HEIGHT / 2),
                pos=(x, y, WALL_HEIGHT / 2),
                quat=(np.cos(turn), 0, 0, np.sin(turn)),
                contype=WALL_BIT,
                conaffinity=0,
            )


def _add_cable(spec: Any, world: TowingWorldModel) -> None:
    cable = world.cable
    x, y, heading = cable.root or (0.0, 0.0, 0.0)
    root = spec.worldbody.add_body(
        name="root", pos=(x, y, cable.radius), quat=(np.cos(heading / 2), 0, 0, np.sin(heading / 2))
    )
    if cable.root is None:
        root.add_freejoint(name="free end")
        # A body without a shape needs a little mass.
        root.mass, root.inertia, root.explicitinertial = 1e-3, (1e-5, 1e-5, 1e-5), True
    _add_links(root, 0, cable.held[0], world)


def _add_vehicles(spec: Any, world: TowingWorldModel) -> None:
    cable, model = world.cable, world.vehicle
    near = ceil(model.body_radius / cable.link_length) + 1
    for m, held in enumerate(cable.held):
        name, welder = f"vehicle {m + 1}", held == cable.held[-1]
        body = spec.worldbody.add_body(name=name, pos=(0, 0, cable.radius))
        body.add_joint(name=f"x {m}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1, 0, 0))
        body.add_joint(name=f"y {m}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 1, 0))
        body.add_joint(name=f"turn {m}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
        body.add_geom(
            name=name,
            type=Geom.mjGEOM_CYLINDER,
            size=(model.body_radius, model.body_height / 2, 0),
            pos=(0, 0, model.body_height / 2 - cable.radius),
            mass=(1 - CABLE_HOLD_MASS_SHARE) * model.mass,
            contype=VEHICLE_BIT,
            conaffinity=VEHICLE_BIT | PASSER_BY_BIT | (0 if welder else WALL_BIT),
        )
        # The link that it holds is part of it, and clear of the floor.
        carried = body.add_body(name=f"link {held}", pos=(-cable.link_length, 0, 0))
        _add_link_shape(carried, held, world)
        if not welder:
            _add_links(body, held + 1, cable.held[m + 1], world)
    for m, held in enumerate(cable.held):
        name = f"vehicle {m + 1}"
        weld = spec.add_equality(
            type=mujoco.mjtEq.mjEQ_WELD,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            name1=name,
            name2=f"end {held}",
            solref=(CABLE_HOLD_TIME_CONSTANT, 1),
            solimp=CABLE_HOLD_IMPEDANCE,
        )
        # Anchor; pose of the link's near end seen from the vehicle; metres a radian; one not used.
        length = cable.link_length
        weld.data = np.array((0, 0, 0, -length, 0, 0, 1, 0, 0, 0, length, 0), float)
        # The cable may pass under the vehicle that holds it, and meets its own neighbours.
        for link in range(max(held - near, 0), min(held + near + 1, cable.links)):
            spec.add_exclude(bodyname1=name, bodyname2=f"link {link}")
        for link in {held - 1, min(held + 1, cable.links - 1)} - {held}:
            spec.add_exclude(bodyname1=f"link {link}", bodyname2=f"link {held}")


def _add_links(body: Any, first: int, end: int, world: TowingWorldModel) -> None:
    """Links behind a body, one behind the other, and then the near end of a link that is held."""
    cable = world.cable
    where = 0.0
    for link in range(first, end):
        body = body.add_body(name=f"link {link}", pos=(where, 0, 0))
        _add_joint(body, link, cable)
        _add_link_shape(body, link, world)
        body.add_geom(  # what lies on the floor: one contact a link
            type=Geom.mjGEOM_SPHERE,
            size=(cable.radius, 0, 0),
            pos=(cable.link_length / 2, 0, 0),
            mass=0,
            contype=0,
            conaffinity=FLOOR_BIT,
            priority=1,
            friction=(cable.friction, 0, 0),
            solref=(FLOOR_CONTACT_TIME_CONSTANT, 1),
            solimp=FLOOR_CONTACT_IMPEDANCE,
        )
        where = cable.link_length
    last = body.add_body(name=f"end {end}", pos=(where, 0, 0))
    _add_joint(last, end, cable)
    mass = CABLE_HOLD_MASS_SHARE * world.vehicle.mass
    turning = mass * world.vehicle.body_radius**2 / 2
    last.ipos, last.mass, last.inertia = (cable.link_length, 0, 0), mass, (turning,) * 3
    last.explicitinertial = True


def _add_joint(body: Any, link: int, cable: CableModel) -> None:
    body.add_joint(
        name=f"joint {link}",
        type=mujoco.mjtJoint.mjJNT_BALL,
        stiffness=(cable.stiffness, 0, 0),
        damping=(cable.damping, 0, 0),
    )


def _add_link_shape(body: Any, link: int, world: TowingWorldModel) -> None:
    cable, free = world.cable, world.exempt_links
    exempt = link < free or link >= cable.links - free
    body.add_geom(
        name=f"link {link}",
        type=Geom.mjGEOM_CAPSULE,
        size=(cable.radius, cable.link_length / 2, 0),
        pos=(cable.link_length / 2, 0, 0),
        quat=(np.sqrt(0.5), 0, np.sqrt(0.5), 0),
        mass=cable.link_mass,
        contype=LINK_BIT,
        conaffinity=LINK_BIT | VEHICLE_BIT | PASSER_BY_BIT | (0 if exempt else WALL_BIT),
    )
