"""How a view, a section and an event are written, and read again."""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array, pose
from tjscan.laser.profile import Profile
from tjscan.scanning.section import ScannedSection, Substep, View

_FLOAT64: Final = 8  # numeric type of foxglove.PackedElementField
MOST_SECTIONS: Final = 1_000_000
LARGEST: Final = 1e9
"""Metres, radians or seconds: what is larger was not measured."""
UNNORMALISED: Final = 1e-6
"""A quaternion whose length is further from one is not one."""
_TEXT: Final = {"type": "string"}
_INTEGER: Final = {"type": "integer"}
_NUMBER: Final = {"type": "number"}


def _object(title: str, **properties: dict[str, Any]) -> dict[str, Any]:
    """An object spelt out to its leaves: viewers refuse schemas that leave anything open."""
    return {"type": "object", "title": title, "properties": properties}


_POINT: Final = _object("foxglove.Point3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_POSE: Final = _object(
    "foxglove.Pose",
    position=_object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER),
    orientation=_object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER),
)
_FIELD: Final = _object("foxglove.PackedElementField", name=_TEXT, offset=_INTEGER, type=_INTEGER)
_STAMP: Final = {
    "timestamp": _object("time", sec=_INTEGER, nsec=_INTEGER),
    "frame_id": _TEXT,
}
_SUBSTEP: Final = {"index": _INTEGER, "substep": _TEXT, "arm_time": _NUMBER}

SCHEMAS: Final[dict[str, dict[str, Any]]] = {
    "foxglove.PoseInFrame": {
        **_STAMP,
        "pose": _POSE,
        "q": {"type": "array", "items": _NUMBER},
        **_SUBSTEP,
    },
    "foxglove.PointCloud": {
        **_STAMP,
        "pose": _POSE,
        "point_stride": _INTEGER,
        "fields": {"type": "array", "items": _FIELD},
        "data": {"type": "string", "contentEncoding": "base64"},
        **_SUBSTEP,
    },
    "tjscan.Section": {
        **_STAMP,
        "index": _INTEGER,
        "points": {"type": "array", "items": _POINT},
        "T_b_g": _POSE,
        "T_b_t": _POSE,
    },
    "tjscan.Event": {**_STAMP, "name": _TEXT, "detail": _TEXT},
}
"""Properties of each message, as JSON schema."""

FLANGE, PROFILE, SECTION, EVENT = "/flange", "/profile", "/section", "/event"
TOPICS: Final = {
    FLANGE: "foxglove.PoseInFrame",
    PROFILE: "foxglove.PointCloud",
    SECTION: "tjscan.Section",
    EVENT: "tjscan.Event",
}
"""Schema of each topic."""


def flange_message(view: View) -> dict[str, Any]:
    """Where the flange was when the profile was taken, in frame b."""
    return {"frame_id": "b", "pose": _from_pose(view.T_b_f), "q": view.q.tolist(), **_substep(view)}


def profile_message(view: View) -> dict[str, Any]:
    """The raw profile: points in frame s, whose pose in frame b stands beside them."""
    profile = view.profile
    columns = {"x": profile.x_s, "y": np.zeros(len(profile)), "z": profile.z_s}
    if profile.intensity is not None:
        columns["intensity"] = profile.intensity
    return {
        "frame_id": "b",
        "pose": _from_pose(view.T_b_s),
        "point_stride": 8 * len(columns),
        "fields": [
            {"name": name, "offset": 8 * i, "type": _FLOAT64} for i, name in enumerate(columns)
        ],
        "data": b64encode(np.column_stack(list(columns.values())).tobytes()).decode("ascii"),
        **_substep(view),
    }


def section_message(scan: ScannedSection) -> dict[str, Any]:
    """A finished section, in frame b."""
    return {
        "frame_id": "b",
        "index": scan.view.index,
        "points": [_from_point(p) for p in scan.points_b],
        "T_b_g": _from_pose(scan.T_b_g),
        "T_b_t": _from_pose(scan.T_b_t),
    }


def read_view(flange: dict[str, Any], profile: dict[str, Any]) -> View:
    """The view that `flange_message` and `profile_message` wrote.

    Raises
    ------
    KeyError, ValueError, TypeError, OverflowError
        If a field is missing, or holds something else.
    """
    table = np.frombuffer(b64decode(profile["data"])).reshape(-1, len(profile["fields"]))
    columns = {field["name"]: table[:, i] for i, field in enumerate(profile["fields"])}
    index, time = profile["index"], profile["arm_time"]
    if type(index) is not int or not 0 <= index <= MOST_SECTIONS or index != flange["index"]:
        raise ValueError(f"section {index!r}")
    (time,) = _finite((time,))
    return View(
        index=index,
        substep=Substep(profile["substep"]),
        T_b_f=to_pose(flange["pose"]),
        T_b_s=to_pose(profile["pose"]),
        profile=Profile(columns["x"], columns["z"], columns.get("intensity"), time),
        time=time,
        q=np.array(_finite(flange["q"])),
    )


def _substep(view: View) -> dict[str, Any]:
    return {"index": view.index, "substep": str(view.substep), "arm_time": view.time}


def _from_pose(T: Array) -> dict[str, dict[str, float]]:
    quaternion = Rotation.from_matrix(T[:3, :3]).as_quat()
    return {
        "position": _from_point(T[:3, 3]),
        "orientation": dict(zip("xyzw", quaternion.tolist(), strict=True)),
    }


def _from_point(p: Array) -> dict[str, float]:
    return dict(zip("xyz", p.tolist(), strict=True))


def to_pose(message: dict[str, dict[str, float]]) -> Array:
    """A pose as the messages write it; raises as `read_view` does."""
    quaternion = _finite(message["orientation"][axis] for axis in "xyzw")
    position = _finite(message["position"][axis] for axis in "xyz")
    if not abs(np.linalg.norm(quaternion) - 1) < UNNORMALISED:
        raise ValueError(f"a quaternion of length {np.linalg.norm(quaternion):.3g}")
    return pose(Rotation.from_quat(quaternion).as_matrix(), position)


def _finite(values: Iterable[Any]) -> list[float]:
    numbers = [float(value) for value in values]
    if not all(abs(number) <= LARGEST for number in numbers):
        raise ValueError(f"{numbers} are no numbers of a scan")
    return numbers
