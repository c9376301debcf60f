"""Keys that set others: a joint from a ratio, a step from the brace, start poses from a joint."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from tjscan.core.config import StrictFileModel
from tjscan.joint.bevel import groove_sections
from tjscan.joint.checks import CHECKED_AZIMUTHS
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import JointFile
from tjscan.joint.geometry import cylindrical_to_j


class DerivedKeySettings(StrictFileModel):
    """Keys of a study from which others of the job and the joint are derived.

    Parameters
    ----------
    leg_to_brace : float, optional
        The leg's outer diameter as a multiple of the brace's.
    leg_wall_to_brace_wall : float, optional
        The leg's wall as a multiple of the brace's.
    room_mm : float, optional
        How far leg and brace run on beyond the groove.
    step_to_brace : float, optional
        The step as a share of the brace's outer diameter, in whole tenths of a millimetre.
    start_azimuth_deg : float or "any", optional
        Teach both start poses from the joint's geometry: the first at this azimuth of frame j,
        the second a step further on. "any" draws it, evenly, by the seed, anew for every joint.
    hand_mm, hand_deg : float
        How far off the taught poses are at most, along and about each axis of frame t in the
        groove; drawn evenly by the seed.
    carry_base : bool
        Carry the arm's base, as on a gantry, to where the arm in its home configuration looks
        at the middle of the arc to be scanned. Needs a taught start and `scan.sections`.
    centre_view : bool
        Choose stand-off and offset of the view so that the groove, from p2 to p4 and over the
        whole arc, lies in the middle of the laser's window. Needs the same.
    """

    leg_to_brace: float | None = Field(default=None, ge=1, le=50)
    leg_wall_to_brace_wall: float | None = Field(default=None, gt=0, le=10)
    room_mm: float | None = Field(default=None, ge=20, le=5000)
    step_to_brace: float | None = Field(default=None, gt=0, le=1)
    start_azimuth_deg: float | Literal["any"] | None = None
    hand_mm: float = Field(default=3.0, ge=0, le=100)
    hand_deg: float = Field(default=5.0, ge=0, le=45)
    carry_base: bool = False
    centre_view: bool = False


LONGEST_MM = 20_000.0
"""What a joint's file allows; a stand-in while the length needed is not known yet."""


def joint_with_derived_dimensions(joint: JointFile, rules: DerivedKeySettings) -> JointFile:
    """Joint file with the dimensions that the derived keys of a study give it.

    Parameters
    ----------
    joint : JointFile
        As its file has it, millimetres and degrees.
    rules : DerivedKeySettings
        What to change.

    Raises
    ------
    ConfigurationError
        If such a joint can't be built.
    """
    leg, brace = joint.leg, joint.brace
    if rules.leg_to_brace is not None:
        diameter = rules.leg_to_brace * brace.outer_diameter_mm
        leg = leg.model_copy(update={"outer_diameter_mm": diameter})
    if rules.leg_wall_to_brace_wall is not None:
        wall = rules.leg_wall_to_brace_wall * brace.wall_mm
        leg = leg.model_copy(update={"wall_mm": wall})
    joint = joint.model_copy(update={"leg": leg, "brace": brace})
    return joint if rules.room_mm is None else _with_room(joint, rules.room_mm)


def _with_room(joint: JointFile, room_mm: float) -> JointFile:
    """The joint with as much leg and brace as leaves room beyond the groove."""
    longest = {"length_mm": LONGEST_MM}
    endless = joint.model_copy(
        update={
            "leg": joint.leg.model_copy(update=longest),
            "brace": joint.brace.model_copy(update=longest),
        }
    )
    up, along = _extent(endless.definition("joint"))
    return joint.model_copy(
        update={
            "leg": joint.leg.model_copy(
                update={"length_mm": float(np.ceil(2 * (1e3 * along + room_mm)))}
            ),
            "brace": joint.brace.model_copy(
                update={"length_mm": float(np.ceil(1e3 * up + room_mm))}
            ),
        }
    )


def _extent(d: JointDefinition) -> tuple[float, float]:
    """How far the groove reaches up the brace and along the leg, metres from where axes cross."""
    s = groove_sections(d, CHECKED_AZIMUTHS)
    foot = d.leg_surface.points_j(s.phi, d.brace_radius) @ d.leg_surface.axis
    root = cylindrical_to_j(s.phi, s.p4[:, 0], s.p4[:, 1]) @ d.leg_surface.axis
    return float(s.p2[:, 1].max()), float(np.abs((foot, root)).max())
