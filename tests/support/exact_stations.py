"""Stations that see a joint exactly as it is defined: no mesh, no laser, no reading in between.

Every laser plane holds the brace's axis, so that a section is a radial half-plane.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array, inverse_pose, pose, pose_from_euler_zyx
from tjscan.groove.section import section_from_points
from tjscan.joint.definition import JointDefinition
from tjscan.joint.edges import JointGrooveSections
from tjscan.joint.geometry import cylindrical_to_j, radial_direction
from tjscan.joint.tubes.fit import ArmRepeatability
from tjscan.laser.profile import Profile
from tjscan.scanning.section import ProfileView, ScannedSection, Substep
from tjscan.stitching.stations import Station

AWAY = 0.23
"""Metres from the brace's wall to the sensor."""

VISIBLE = 0.04
"""Metres of each wall that are seen."""

CLEAR = ArmRepeatability(0.0, 0.0)


def exact_station(
    joint: JointDefinition,
    name: str,
    azimuths: Array,
    *,
    seed: int = 0,
    arm: ArmRepeatability = CLEAR,
    T_w_j: Array | None = None,
    oval: float = 0.0,
) -> tuple[Station, Array]:
    """A station that saw sections at azimuths (radians), and where it truly stands: T_j_b.

    `oval` is how far the brace, and the groove with it, bulges along x and is dented along y.
    """
    rng = np.random.default_rng([seed, *name.encode()])
    T_j_b = pose_from_euler_zyx(rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3))
    spread = np.repeat([arm.position, arm.angle], 3) / np.sqrt(3)
    looks = [
        _look(joint, float(phi), k, T_j_b, spread * rng.standard_normal(6), oval)
        for k, phi in enumerate(azimuths)
    ]
    nominal = (np.eye(4) if T_w_j is None else T_w_j) @ T_j_b
    off = pose(
        Rotation.from_rotvec(rng.uniform(-0.02, 0.02, 3)).as_matrix(), rng.normal(size=3) / 200
    )
    return Station(name, nominal @ off, tuple(looks), tuple(looks)), T_j_b


def _look(
    joint: JointDefinition, phi: float, number: int, T_j_b: Array, error: Array, oval: float
) -> ScannedSection:
    sections = JointGrooveSections(joint, np.array([phi]))
    p2, p3, p4 = (getattr(sections, name)[0] for name in ("p2", "p3", "p4"))
    wall = np.column_stack((np.full(200, joint.brace_radius), p2[1] + np.linspace(VISIBLE, 0, 200)))
    rho = p4[0] + np.linspace(0, VISIBLE, 200)
    rho = rho[rho < 0.97 * joint.leg_radius]
    leg = np.column_stack((rho, joint.leg_surface.height(phi, rho)))
    bulge = oval * np.cos(2 * phi) * np.array((1.0, 0.0))
    p2, p3, p4, wall = (part + bulge for part in (p2, p3, p4, wall))
    rz = np.concatenate((wall, leg))
    # Sensor: x up the brace, z back to its axis.
    up, back = np.array((0.0, 0.0, 1.0)), -radial_direction(phi)
    origin = cylindrical_to_j(phi, joint.brace_radius + AWAY, p2[1])
    T_j_s = pose(np.column_stack((up, np.cross(back, up), back)), origin)

    def in_s(rz: Array) -> Array:
        return np.column_stack(
            (rz[:, 1] - p2[1], np.zeros(len(rz)), joint.brace_radius + AWAY - rz[:, 0])
        )

    slope = float(joint.leg_surface.slope(phi, p4[0]))
    out = np.array((slope, 0.0, -1.0)) / np.hypot(slope, 1.0)
    five = in_s(np.array([wall[0], p2, p3, p4, leg[-1]]))
    groove = section_from_points(
        five, wall_s=(-1.0, 0.0, 0.0), leg_s=out, covariance=1e-12 * np.eye(8)
    )
    seen = in_s(rz)
    T_b_s = inverse_pose(T_j_b) @ T_j_s
    # The arm says that it stands a little elsewhere than it does.
    flange = T_b_s @ pose(p=(0.1, 0.0, -0.15))
    said = pose(Rotation.from_rotvec(error[3:]).as_matrix(), error[:3])
    said = pose(p=flange[:3, 3]) @ said @ pose(p=-flange[:3, 3])
    view = ProfileView(
        number,
        Substep.CORRECTION,
        said @ flange,
        said @ T_b_s,
        Profile(seen[:, 0], seen[:, 2]),
        float(number),
        np.zeros(6),
    )
    return ScannedSection(view, groove, np.eye(4))
