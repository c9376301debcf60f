"""Write the URDFs of the arms in ``tjscan/robot/models``: ``python cad/arm_models.py``.

The numbers are the maker's nominal ones (Universal Robots' public ROS 2 description); every
real arm has calibrated deltas of its own, which only its controller knows. ``base_link`` is
the DH base frame, in which the controller shows its poses, and ``flange`` is DH frame 6, whose
z axis is square to the flange and points out. The bodies are capsules: an assumption good
enough to draw the arm and to keep it clear of things, not the maker's geometry.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

Vector = tuple[float, float, float]

JOINTS: Final = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
LINKS: Final = (
    "base_link",
    "shoulder_link",
    "upper_arm_link",
    "forearm_link",
    "wrist_1_link",
    "wrist_2_link",
    "wrist_3_link",
)
TWISTS: Final = (pi / 2, 0.0, 0.0, pi / 2, -pi / 2, 0.0)
"""Standard DH link twists alpha of every Universal Robots arm."""

TURN: Final = 2 * pi
ELBOW_TURN: Final = pi
BASE_MASS: Final = 4.0
"""Assumption: the base is bolted down, so its mass moves nothing."""


@dataclass(frozen=True, slots=True)
class ArmModel:
    """Dimensions, speeds and masses of one arm, from which its URDF is made.

    Parameters
    ----------
    d1, a2, a3, d4, d5, d6 : float
        Standard DH lengths in metres.
    upper_arm_side, forearm_side : float
        How far the two long links lie beside the shoulder's axis, along the lift axes,
        in metres. They cancel out of the kinematics, not out of the bodies.
    speeds : tuple of float
        Joint speed limits in degrees per second, shoulder to wrist 3.
    masses : tuple of float
        Link masses in kg, shoulder to wrist 3.
    arm_radius, forearm_radius, wrist_radius : float
        Radii of the capsules that stand for the links, in metres; assumptions.
    """

    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float
    upper_arm_side: float
    forearm_side: float
    speeds: tuple[float, float, float, float, float, float]
    masses: tuple[float, float, float, float, float, float]
    arm_radius: float
    forearm_radius: float
    wrist_radius: float


# fmt: off
ARMS: Final = {
    "ur5e": ArmModel(
        0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996, 0.138, 0.007,
        (180, 180, 180, 180, 180, 180), (3.761, 8.058, 2.846, 1.37, 1.3, 0.365),
        0.06, 0.052, 0.045,
    ),
    "ur10e": ArmModel(
        0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655, 0.1762, 0.0393,
        (120, 120, 180, 180, 180, 180), (7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
        0.075, 0.065, 0.06,
    ),
    "ur16e": ArmModel(
        0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655, 0.1762, 0.0393,
        (120, 120, 180, 180, 180, 180), (7.369, 10.45, 4.321, 2.18, 2.033, 0.907),
        0.075, 0.065, 0.06,
    ),
    "ur20": ArmModel(
        0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543, 0.26, 0.043,
        (120, 120, 150, 210, 210, 210), (16.343, 29.632, 7.879, 3.054, 3.126, 0.926),
        0.09, 0.078, 0.065,
    ),
    "ur30": ArmModel(
        0.2363, -0.637, -0.5037, 0.201, 0.1593, 0.1543, 0.26, 0.043,
        (120, 120, 150, 210, 210, 210), (16.343, 28.542, 7.156, 3.054, 3.126, 0.926),
        0.09, 0.078, 0.065,
    ),
}
# fmt: on


@dataclass(frozen=True, slots=True)
class Capsule:
    """A capsule, parallel to an axis of its link's frame, that stands for a link; metres."""

    start: Vector
    end: Vector
    radius: float

    @property
    def axis(self) -> int:
        """Axis of the frame that the capsule lies along: 0, 1 or 2."""
        return max(range(3), key=lambda i: abs(self.end[i] - self.start[i]))

    @property
    def length(self) -> float:
        """Length of the capsule's middle segment."""
        return abs(self.end[self.axis] - self.start[self.axis])

    @property
    def centre(self) -> Vector:
        """Middle of the capsule, to the nanometre."""
        x, y, z = (round((a + b) / 2, 9) for a, b in zip(self.start, self.end, strict=True))
        return x, y, z


def link_capsules(arm: ArmModel) -> tuple[Capsule, ...]:
    """One capsule for each link, base first, in the frame of the link."""
    thick, thin = arm.arm_radius, arm.wrist_radius
    upper, fore = arm.upper_arm_side, arm.forearm_side
    return (
        Capsule((0, 0, thick), (0, 0, arm.d1), thick),
        Capsule((0, 0, arm.d1), (0, -upper, arm.d1), thick),
        Capsule((0, 0, upper), (arm.a2, 0, upper), thick),
        Capsule((0, 0, fore), (arm.a3, 0, fore), arm.forearm_radius),
        Capsule((0, 0, fore), (0, 0, arm.d4), thin),
        Capsule((0, 0, 0), (0, 0, arm.d5), thin),
        # Its round end touches the flange's plane, and does not reach into the tool.
        Capsule((0, 0, 0), (0, 0, round(arm.d6 - thin, 9)), thin),
    )


def urdf_text(name: str) -> str:
    """Text of the URDF of a model in `ARMS`."""
    arm = ARMS[name]
    robot = ET.Element("robot", name=name)
    masses = (BASE_MASS, *arm.masses)
    for link, mass, body in zip(LINKS, masses, link_capsules(arm), strict=True):
        _add_link(robot, link, mass, body)
    ET.SubElement(robot, "link", name="flange")

    # The frame of link i is DH frame i-1 turned by the angle of joint i, so the joint after it
    # stands at the rest of the DH transform: Tz(d) Tx(a) Rx(alpha).
    d = (arm.d1, 0.0, 0.0, arm.d4, arm.d5, arm.d6)
    a = (0.0, arm.a2, arm.a3, 0.0, 0.0, 0.0)
    at: list[tuple[Vector, float]] = [((0.0, 0.0, 0.0), 0.0)]
    at += [((a_i, 0.0, d_i), twist) for a_i, d_i, twist in zip(a, d, TWISTS, strict=True)]
    for i, joint in enumerate(JOINTS):
        element = _add_joint(robot, joint, "revolute", LINKS[i], LINKS[i + 1], *at[i])
        ET.SubElement(element, "axis", xyz="0 0 1")
        turn = ELBOW_TURN if joint == "elbow_joint" else TURN
        ET.SubElement(
            element,
            "limit",
            lower=repr(-turn),
            upper=repr(turn),
            velocity=repr(radians(arm.speeds[i])),
            effort="0",
        )
    _add_joint(robot, "flange_joint", "fixed", LINKS[-1], "flange", *at[-1])

    ET.indent(robot)
    head = f"<!-- Nominal {name}, written by cad/arm_models.py: do not edit. -->"
    return f'<?xml version="1.0"?>\n{head}\n{ET.tostring(robot, encoding="unicode")}\n'


def write_urdfs(folder: Path) -> None:
    """Write the URDF of every model into `folder`."""
    for name in ARMS:
        (folder / f"{name}.urdf").write_text(urdf_text(name), encoding="utf-8")


def _add_link(robot: ET.Element, name: str, mass: float, body: Capsule) -> None:
    link = ET.SubElement(robot, "link", name=name)
    _add_solids(link, "visual", body)
    _add_solids(link, "collision", body)
    # The mass is spread evenly over the cylinder: an assumption.
    along = mass * body.radius**2 / 2
    across = mass * (3 * body.radius**2 + body.length**2) / 12
    moments = [repr(round(along if i == body.axis else across, 8)) for i in range(3)]
    inertia = dict(zip(("ixx", "iyy", "izz"), moments, strict=True))
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=_text(body.centre))
    ET.SubElement(inertial, "mass", value=repr(mass))
    ET.SubElement(inertial, "inertia", {**inertia, "ixy": "0", "ixz": "0", "iyz": "0"})


def _add_solids(link: ET.Element, kind: str, body: Capsule) -> None:
    """A capsule as a cylinder and two spheres, since URDF has no capsule."""
    length, radius = repr(round(body.length, 9)), repr(body.radius)
    along_z: tuple[Vector, ...] = ((0.0, pi / 2, 0.0), (pi / 2, 0.0, 0.0), (0.0, 0.0, 0.0))
    solid = _add_solid(link, kind, body.centre, along_z[body.axis])
    ET.SubElement(solid, "cylinder", radius=radius, length=length)
    for end in (body.start, body.end):
        ET.SubElement(_add_solid(link, kind, end, (0.0, 0.0, 0.0)), "sphere", radius=radius)


def _add_solid(link: ET.Element, kind: str, xyz: Vector, rpy: Vector) -> ET.Element:
    element = ET.SubElement(link, kind)
    ET.SubElement(element, "origin", xyz=_text(xyz), rpy=_text(rpy))
    return ET.SubElement(element, "geometry")


def _add_joint(
    robot: ET.Element, name: str, kind: str, parent: str, child: str, xyz: Vector, twist: float
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_text(xyz), rpy=_text((twist, 0.0, 0.0)))
    return joint


def _text(vector: Vector) -> str:
    return " ".join(repr(float(v)) for v in vector)


if __name__ == "__main__":
    write_urdfs(Path(__file__).parents[1] / "tjscan" / "robot" / "models")
