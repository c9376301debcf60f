"""An arm as a URDF describes it.

Frame b is the frame ``base`` of the URDF if it has one, else its root link; for the arms in
``robot/models`` that is the DH base frame, in which a Universal Robots controller shows its
poses. Frame f is ``tool0`` if the URDF has one (by the convention of ROS-Industrial its z
axis is square to the flange, while the axis of their ``flange`` is not), else ``flange``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from tjscan.core.errors import ConfigurationError, nearest_word
from tjscan.core.files import check_file_size
from tjscan.robot.closed_form import GEOMETRY_TOLERANCE, UrDhLengths

ARM_MODELS: Final = (
    "ur5e",
    "ur10e",
    "ur16e",
    "ur20",
    "ur30",
    "kr5_arc",
    "irb1600_10_145",
    "m10ia",
)
"""Names of the arms whose URDF comes with tjscan."""

LIMIT_KEYS: Final = ("lower", "upper", "velocity", "effort")
"""What a joint's limits state, in radians and rad/s."""

MOST_URDF_BYTES: Final = 5_000_000
"""A larger file describes no arm."""


def read_urdf(urdf: Path) -> tuple[Any, int, int]:
    """Pinocchio's model of the arm that a file describes, and the numbers of its frames b and f.

    Raises
    ------
    ConfigurationError
        If there is no such file, or it is no URDF of an open chain that the inverse can handle.
    """
    if not urdf.exists():
        beside = [file.name for file in urdf.parent.glob("*.urdf")]
        known = nearest_word(urdf.name, [*ARM_MODELS, *beside])
        raise ConfigurationError(f"there is no such URDF; did you mean: {known}?")
    text = ""
    try:
        check_file_size(urdf, MOST_URDF_BYTES, "a URDF")
        text = urdf.read_text(encoding="utf-8")
        model = pin.buildModelFromXML(text)
    except (ValueError, RuntimeError, OSError) as error:
        joint = _joint_without_limits(text)
        why = f"joint {joint} has no {', '.join(LIMIT_KEYS)}" if joint else str(error)
        raise ConfigurationError(f"is not a URDF: {why}") from None
    base, flange = _frames_b_and_f(model)
    _check_joint_chain(model, flange)
    return model, base, flange


def _joint_without_limits(text: str) -> str | None:
    """Name of the first revolute joint whose limits are not all stated."""
    try:
        joints = ElementTree.fromstring(text).iter("joint")
    except ElementTree.ParseError:
        return None
    for joint in joints:
        limit = joint.find("limit")
        stated = {} if limit is None else limit.attrib
        if joint.get("type") == "revolute" and not set(LIMIT_KEYS) <= set(stated):
            return joint.get("name")
    return None


def _frames_b_and_f(model: Any) -> tuple[int, int]:
    """Numbers of the frames b and f; b must not move."""
    names = [str(frame.name) for frame in model.frames]
    kinds = [frame.type for frame in model.frames]
    base = names.index("base") if "base" in names else kinds.index(pin.FrameType.BODY)
    if model.frames[base].parentJoint != 0:
        raise ConfigurationError("its frame 'base' moves with a joint")
    for name in ("tool0", "flange"):
        if name in names:
            return base, names.index(name)
    raise ConfigurationError(
        "it has no link 'tool0' or 'flange': add one with a fixed joint, its z axis square to "
        "the flange and pointing out"
    )


def _check_joint_chain(model: Any, flange: int) -> None:
    """Refuse all but an open chain of six or more revolute joints that have limits."""
    moving_joints = set(model.supports[model.frames[flange].parentJoint])
    for i in range(1, model.njoints):
        name, kind = model.names[i], model.joints[i].shortname()
        if not kind.startswith("JointModelR") or "UB" in kind or "Unbounded" in kind:
            raise ConfigurationError(
                f"joint {name} is {kind.removeprefix('JointModel')}; tjscan knows revolute joints "
                "with limits alone: make it fixed or revolute"
            )
        if i not in moving_joints:
            raise ConfigurationError(f"joint {name} does not move the flange: make it fixed")
    if model.nq < 6:
        message = f"it has {model.nq} joints between base and flange; six or more are needed"
        raise ConfigurationError(message)
    bad = ~(model.upperPositionLimit > model.lowerPositionLimit) | ~(model.velocityLimit > 0)
    if bad.any():
        name = model.names[1 + int(bad.argmax())]
        message = f"joint {name} has no range or no speed: give it lower < upper and velocity > 0"
        raise ConfigurationError(message)


def ur_dh_lengths(model: Any) -> UrDhLengths | None:
    """DH lengths if the arm is of the Universal Robots type, up to its calibration.

    A joint's frame may slide along its axis; the DH length is the sum along that axis.
    """
    if model.nq != 6 or any(model.joints[i].shortname() != "JointModelRZ" for i in range(1, 7)):
        return None
    M = [placement.homogeneous for placement in model.jointPlacements][2:]
    for T, twist in zip(M, (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2), strict=True):
        c, s = np.cos(twist), np.sin(twist)
        if not np.allclose(
            T[:3, :3], [[1, 0, 0], [0, c, -s], [0, s, c]], rtol=0, atol=GEOMETRY_TOLERANCE
        ):
            return None
    (x2, y2, z2), (x3, y3, z3), (x4, y4, z4), (x5, y5, z5), (x6, y6, z6) = (T[:3, 3] for T in M)
    if np.abs([x2, y3, y4, x5, x6]).max() > GEOMETRY_TOLERANCE:
        return None
    lengths = (z2, x3, x4, z3 + z4 + z5 - y2, z6 - y5, y6)
    return UrDhLengths(*(float(length) for length in lengths))
