"""Write the URDFs of the arms in ``tjscan/robot/models``: ``python cad/arm_models.py``.

The numbers are the maker's nominal ones; every real arm has calibrated deltas of its own, which
only its controller knows. Of Universal Robots arms (public ROS 2 description) ``base_link`` is
the DH base frame, in which the controller shows its poses, and ``flange`` is DH frame 6, whose
z axis is square to the flange and points out. Of arms with a spherical wrist, ``base`` and
``tool0`` are the frames that their controllers show, and all joint frames are parallel where the
joints are zero; their makers state no masses of links. The bodies are capsules: an assumption
good enough to draw the arm and to keep it clear of things, not the maker's geometry.
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


AXES: Final = {"x": 0, "y": 1, "z": 2}
WRIST_LINKS: Final = ("base_link", *(f"link_{i}" for i in range(1, 7)))


@dataclass(frozen=True, slots=True)
class WristArmModel:
    """What the URDF of an arm with a spherical wrist is made from.

    Parameters
    ----------
    source : str
        Where the numbers are from.
    base : float
        Height of the controller's base frame above the foot, in metres.
    origins : tuple of Vector
        Each joint in the frame of the one before, and ``tool0`` in the last, in metres.
    axes : tuple of str
        Along which the joints turn, such as -z.
    tool_rpy : Vector
        Orientation of ``tool0`` in the last joint's frame, in radians.
    limits : tuple of (float, float)
        Joint limits in degrees.
    speeds : tuple of float
        Joint speed limits in degrees per second.
    bodies : tuple of Capsule
        For each link, base first, in the frame of the link; assumptions.
    """

    source: str
    base: float
    origins: tuple[Vector, ...]
    axes: tuple[str, ...]
    tool_rpy: Vector
    limits: tuple[tuple[float, float], ...]
    speeds: tuple[float, ...]
    bodies: tuple[Capsule, ...]


# fmt: off
WRIST_ARMS: Final = {
    "kr5_arc": WristArmModel(
        "dimensions, limits and speeds of the KUKA KR 5 arc after its maker's specification, as "
        "ros-industrial/kuka_experimental (kuka_kr5_support) has them; bodies sized after its "
        "meshes",
        0.0,
        ((0, 0, 0.4), (0.18, 0, 0), (0.6, 0, 0), (0, 0, 0.12), (0.62, 0, 0), (0, 0, 0),
         (0.115, 0, 0)),
        ("-z", "y", "y", "-x", "y", "-x"), (0.0, pi / 2, 0.0),
        ((-155, 155), (-180, 65), (-15, 158), (-350, 350), (-130, 130), (-350, 350)),
        (154, 154, 228, 343, 384, 721),
        (
            Capsule((0, 0, 0.14), (0, 0, 0.15), 0.14),
            Capsule((-0.05, 0, 0), (0.18, 0, 0), 0.13),
            Capsule((0, -0.16, 0), (0.6, -0.16, 0), 0.1),
            Capsule((-0.17, 0, 0.11), (0.27, 0, 0.11), 0.11),
            Capsule((0.36, 0, 0), (0.58, 0, 0), 0.075),
            Capsule((0, 0, 0), (0.05, 0, 0), 0.048),
            Capsule((0.085, 0, 0), (0.09, 0, 0), 0.025),
        ),
    ),
    "irb1600_10_145": WristArmModel(
        "dimensions, limits and speeds of the ABB IRB 1600-10/1.45 after its maker's "
        "3HAC023604-001, as ros-industrial/abb_experimental (abb_irb1600_support) has had them; "
        "bodies sized after its meshes",
        0.0,
        ((0, 0, 0.4865), (0.15, 0, 0), (0, 0, 0.7), (0, 0, 0), (0.6, 0, 0), (0, 0, 0),
         (0.065, 0, 0)),
        ("z", "y", "y", "x", "y", "x"), (0.0, pi / 2, 0.0),
        ((-180, 180), (-90, 120), (-245, 65), (-200, 200), (-115, 115), (-400, 400)),
        (180, 180, 185, 385, 400, 460),
        (
            Capsule((0, 0, 0.14), (0, 0, 0.15), 0.14),
            Capsule((0, 0, -0.05), (0.16, 0, -0.05), 0.17),
            Capsule((0, -0.18, 0), (0, -0.18, 0.7), 0.08),
            Capsule((-0.05, 0.02, 0), (0.2, 0.02, 0), 0.13),
            Capsule((0.36, 0, 0), (0.57, 0, 0), 0.06),
            Capsule((0, 0, 0), (0.01, 0, 0), 0.04),
            Capsule((0.03, 0, 0), (0.04, 0, 0), 0.025),
        ),
    ),
    "m10ia": WristArmModel(
        "dimensions, limits and speeds of the FANUC M-10iA after its maker's B-82754EN/09, as "
        "ros-industrial/fanuc (fanuc_m10ia_support) has them; bodies sized after its meshes. "
        "joint_3 is counted from the upper arm: J3 of the controller, from the horizontal, and J2 "
        "together",
        0.45,
        ((0, 0, 0.45), (0.15, 0, 0), (0, 0, 0.6), (0, 0, 0.2), (0.64, 0, 0), (0, 0, 0),
         (0.1, 0, 0)),
        ("z", "y", "-y", "-x", "-y", "-x"), (pi, -pi / 2, 0.0),
        ((-180, 180), (-90, 160), (-180, 264), (-190, 190), (-190, 190), (-360, 360)),
        (210, 190, 210, 400, 400, 600),
        (
            Capsule((0, 0, 0.13), (0, 0, 0.15), 0.13),
            Capsule((0, 0, -0.03), (0.14, 0, -0.03), 0.13),
            Capsule((0, -0.13, 0), (0, -0.13, 0.6), 0.09),
            Capsule((0.06, 0, 0), (0.06, 0, 0.2), 0.1),
            Capsule((0.2, -0.03, 0), (0.6, -0.03, 0), 0.075),
            Capsule((0, 0, 0), (0.04, 0, 0), 0.05),
            Capsule((0.06, 0, 0), (0.07, 0, 0), 0.03),
        ),
    ),
}
# fmt: on


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
    """Text of the URDF of a model in `ARMS` or `WRIST_ARMS`."""
    robot = ET.Element("robot", name=name)
    source = ""
    if name in ARMS:
        _add_ur_arm(robot, ARMS[name])
    else:
        _add_wrist_arm(robot, WRIST_ARMS[name])
        source = f" Source: {WRIST_ARMS[name].source}."
    ET.indent(robot)
    head = f"<!-- Nominal {name}, written by cad/arm_models.py: do not edit.{source} -->"
    return f'<?xml version="1.0"?>\n{head}\n{ET.tostring(robot, encoding="unicode")}\n'


def write_urdfs(folder: Path) -> None:
    """Write the URDF of every model into `folder`."""
    for name in (*ARMS, *WRIST_ARMS):
        (folder / f"{name}.urdf").write_text(urdf_text(name), encoding="utf-8")


def _add_ur_arm(robot: ET.Element, arm: ArmModel) -> None:
    masses = (BASE_MASS, *arm.masses)
    for link, mass, body in zip(LINKS, masses, link_capsules(arm), strict=True):
        _add_link(robot, link, mass, body)
    ET.SubElement(robot, "link", name="flange")

    # The frame of link i is DH frame i-1 turned by the angle of joint i, so the joint after it
    # stands at the rest of the DH transform: Tz(d) Tx(a) Rx(alpha).
    d = (arm.d1, 0.0, 0.0, arm.d4, arm.d5, arm.d6)
    a = (0.0, arm.a2, arm.a3, 0.0, 0.0, 0.0)
    at: list[tuple[Vector, Vector]] = [((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]
    at += [
        ((a_i, 0.0, d_i), (twist, 0.0, 0.0)) for a_i, d_i, twist in zip(a, d, TWISTS, strict=True)
    ]
    for i, joint in enumerate(JOINTS):
        turn = ELBOW_TURN if joint == "elbow_joint" else TURN
        limits = (-turn, turn, radians(arm.speeds[i]))
        _add_revolute_joint(robot, joint, (LINKS[i], LINKS[i + 1]), *at[i], "0 0 1", limits)
    _add_joint(robot, "flange_joint", "fixed", (LINKS[-1], "flange"), *at[-1])


def _add_wrist_arm(robot: ET.Element, arm: WristArmModel) -> None:
    for link, body in zip(WRIST_LINKS, arm.bodies, strict=True):
        _add_link(robot, link, None, body)
    for link in ("base", "tool0"):
        ET.SubElement(robot, "link", name=link)
    straight = (0.0, 0.0, 0.0)
    for i, (axis, limits, speed) in enumerate(zip(arm.axes, arm.limits, arm.speeds, strict=True)):
        along = ["0", "0", "0"]
        along[AXES[axis[-1]]] = "-1" if axis.startswith("-") else "1"
        _add_revolute_joint(
            robot,
            f"joint_{i + 1}",
            (WRIST_LINKS[i], WRIST_LINKS[i + 1]),
            arm.origins[i],
            straight,
            " ".join(along),
            (radians(limits[0]), radians(limits[1]), radians(speed)),
        )
    _add_joint(robot, "base_joint", "fixed", ("base_link", "base"), (0, 0, arm.base), straight)
    last = (WRIST_LINKS[-1], "tool0")
    _add_joint(robot, "tool0_joint", "fixed", last, arm.origins[-1], arm.tool_rpy)


def _add_link(robot: ET.Element, name: str, mass: float | None, body: Capsule) -> None:
    link = ET.SubElement(robot, "link", name=name)
    _add_solids(link, "visual", body)
    _add_solids(link, "collision", body)
    if mass is None:
        return
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


def _add_revolute_joint(
    robot: ET.Element,
    name: str,
    links: tuple[str, str],
    xyz: Vector,
    rpy: Vector,
    axis: str,
    limits: tuple[float, float, float],
) -> None:
    """A joint with its least and largest angle and its speed, in radians and rad/s."""
    lower, upper, speed = (repr(one) for one in limits)
    element = _add_joint(robot, name, "revolute", links, xyz, rpy)
    ET.SubElement(element, "axis", xyz=axis)
    ET.SubElement(element, "limit", lower=lower, upper=upper, velocity=speed, effort="0")


def _add_joint(
    robot: ET.Element, name: str, kind: str, links: tuple[str, str], xyz: Vector, rpy: Vector
) -> ET.Element:
    parent, child = links
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_text(xyz), rpy=_text(rpy))
    return joint


def _text(vector: Vector) -> str:
    return " ".join(repr(float(v)) for v in vector)


if __name__ == "__main__":
    write_urdfs(Path(__file__).parents[1] / "tjscan" / "robot" / "models")
