"""The course of a hull joint in the hull's surface: a straight line or an arc.

Frame h lies in the hull's surface: x along the joint at its start, y to the right, z into the
hull. Headings count from x towards y: clockwise as seen from outside.
"""

from __future__ import annotations

from math import atan2, cos, hypot, sin

from tjscan.joint.hull import HullJoint


def joint_pose(joint: HullJoint, along: float) -> tuple[float, float, float]:
    """Place and direction of a joint's line.

    Parameters
    ----------
    joint : HullJoint
    along : float
        Distance along the joint, in metres; beyond its ends it goes on as it is.

    Returns
    -------
    tuple of float
        x, y in frame h, in metres, and heading, in radians.
    """
    kappa = joint.curvature
    if kappa == 0:
        return along, 0.0, 0.0
    turned = kappa * along
    return sin(turned) / kappa, 2 * sin(turned / 2) ** 2 / kappa, turned


def place_beside_joint(joint: HullJoint, x: float, y: float) -> tuple[float, float]:
    """Distance along a joint of its nearest point, and distance to the right of it, in metres.

    Parameters
    ----------
    joint : HullJoint
    x, y : float
        In frame h, in metres.
    """
    kappa = joint.curvature
    if kappa == 0:
        return x, y
    # Seen from the arc's centre, (0, 1 / kappa).
    sign = 1.0 if kappa > 0 else -1.0
    along = atan2(sign * x, sign * (1 / kappa - y)) / kappa
    return along, sign * (1 / abs(kappa) - hypot(x, 1 / kappa - y))


def laser_offset(joint: HullJoint, x: float, y: float, heading: float) -> tuple[float, float]:
    """Where a laser line crosses a joint.

    Parameters
    ----------
    joint : HullJoint
    x, y : float
        The laser's centre in frame h, in metres.
    heading : float
        Of the vehicle: the line runs square to it. Radians.

    Returns
    -------
    along, offset : float
        Place on the joint, and the laser's centre minus the joint along the line, positive where
        it stands to the right. Metres.
    """
    along, right = place_beside_joint(joint, x, y)
    for _ in range(4):  # a line that runs at a small angle meets the joint a little farther on
        px, py, direction = joint_pose(joint, along)
        relative = heading - direction
        ahead = (x - px) * cos(direction) + (y - py) * sin(direction)
        right = (y - py) * cos(direction) - (x - px) * sin(direction)
        offset = right / cos(relative)
        along += ahead + offset * sin(relative)
    return along, offset
