"""Profiles of a hull's V joint for the groove's tests, and where the joint truly is in them."""

from __future__ import annotations

import numpy as np

from tjscan.core.frames import Array
from tjscan.crawler.joint_tracking.registration import JointPlacement
from tjscan.joint.hull import HullJoint, WeldBead, hull_section
from tjscan.laser.profile import Profile
from tjscan.laser.section_laser import (
    SectionLaserModel,
    SectionLaserPose,
    section_in_sensor,
    simulate_section_profile,
)

AHEAD = SectionLaserPose()
DEFAULT = SectionLaserModel()
ARC_20, ARC_40 = SectionLaserModel(arc=0.2), SectionLaserModel(arc=0.4)
EXACT = SectionLaserModel(noise=0.0, step=0.0, missing=0.0)

FILLED_15_MM = HullJoint(
    beads=(
        WeldBead(level=10e-3),
        WeldBead(level=15e-3, crown=0.8e-3, right=0.3),
        WeldBead(level=15e-3, crown=0.8e-3, left=0.1),
    )
)
"""Three quarters of its depth are filled."""

NEARLY_FILLED = HullJoint(
    beads=(
        WeldBead(level=15e-3),
        WeldBead(level=17e-3, crown=0.5e-3),
        WeldBead(level=18.5e-3, crown=0.5e-3, right=0.2),
        WeldBead(level=18.5e-3, crown=0.5e-3, left=-0.1),
    ),
    ripple=0.1e-3,
)
"""Its last two passes leave 1.5 mm of the bevels, one on the left and one on the right."""

CAPPED = HullJoint(beads=(WeldBead(level=20e-3, crown=2e-3, left=-1.1, right=1.1),))
"""Its edges are welded over."""


def see(
    joint: HullJoint,
    rng: np.random.Generator,
    model: SectionLaserModel = DEFAULT,
    pose: SectionLaserPose = AHEAD,
    *,
    passes: int = 9,
    along: float = 0.0,
) -> Profile:
    """Take a profile of a joint."""
    return simulate_section_profile(hull_section(joint, along, passes), pose, model, rng)


def true_placement(pose: SectionLaserPose = AHEAD) -> JointPlacement:
    """Where the joint truly is in a profile taken from a pose."""
    centre: Array = section_in_sensor(np.zeros((1, 2)), pose)[0]
    return JointPlacement(
        centre=float(centre[0]),
        hull_z=float(centre[1]),
        roll=pose.roll,
        centre_sigma=0.0,
    )


def mirrored(profile: Profile) -> Profile:
    """The profile as the mirror image of the scene gives it."""
    return Profile(-profile.x_s[::-1], profile.z_s[::-1], time=profile.time)


def top_edges(joint: HullJoint) -> Array:
    """Left and right top edge of the groove, (across, height) in metres, shape (2, 2)."""
    half, step = joint.width / 2, joint.high_low / 2
    return np.array([(-half, -step), (half, step)])


def area_left_to_fill(joint: HullJoint, section: Array) -> float:
    """Area between a section and the line between the groove's top edges, in m².

    Parameters
    ----------
    joint : HullJoint
    section : ndarray, shape (n, 2)
        As `hull_section` gives it.
    """
    (left, low), (right, high) = top_edges(joint).tolist()
    inside = (section[:, 0] > left) & (section[:, 0] < right)
    x = np.concatenate(([left], section[inside, 0], [right]))
    below = low + (high - low) * (x - left) / (right - left) - np.interp(x, *section.T)
    return float(np.trapezoid(np.maximum(below, 0.0), x))
