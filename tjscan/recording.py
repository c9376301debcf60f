"""The recording of a scan: an MCAP file to which every pose, profile, section and event goes.

Robotics viewers read it as it is. Poses and profiles use the public Foxglove schemas;
coordinates are metres. Nothing is chunked: a record on disk needs none after it to be read.
"""

from __future__ import annotations

import json
import os
import time
from base64 import b64encode
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from mcap.writer import CompressionType, Writer
from scipy.spatial.transform import Rotation

from tjscan.errors import RecordingError
from tjscan.frames import Array
from tjscan.scanning.scan import Scan, View

_FLOAT64 = 8  # numeric type of foxglove.PackedElementField
_OBJECT: dict[str, Any] = {"type": "object"}
_POSE = {"type": "object", "properties": {"position": _OBJECT, "orientation": _OBJECT}}
_SCHEMAS: dict[str, dict[str, Any]] = {
    "foxglove.PoseInFrame": {
        "timestamp": _OBJECT,
        "frame_id": {"type": "string"},
        "pose": _POSE,
    },
    "foxglove.PointCloud": {
        "timestamp": _OBJECT,
        "frame_id": {"type": "string"},
        "pose": _POSE,
        "point_stride": {"type": "integer"},
        "fields": {"type": "array", "items": _OBJECT},
        "data": {"type": "string", "contentEncoding": "base64"},
    },
    "tjscan.Section": {
        "timestamp": _OBJECT,
        "frame_id": {"type": "string"},
        "index": {"type": "integer"},
        "points": {"type": "array"},
        "T_b_g": {"type": "array"},
        "T_b_t": {"type": "array"},
    },
    "tjscan.Event": {
        "timestamp": _OBJECT,
        "name": {"type": "string"},
        "detail": {"type": "string"},
    },
}
_TOPICS = {
    "/flange": "foxglove.PoseInFrame",
    "/profile": "foxglove.PointCloud",
    "/section": "tjscan.Section",
    "/event": "tjscan.Event",
}


class Recording:
    """Writes ``scan.mcap``. Every record reaches the file at once, the disk after each section.

    Parameters
    ----------
    file : Path
        Must not exist yet.

    Raises
    ------
    RecordingError
        If the file can't be written.
    """

    def __init__(self, file: Path) -> None:
        self._file = file

    def __enter__(self) -> Self:
        try:
            self._stream = self._file.open("xb")
        except OSError as error:
            raise RecordingError(f"{self._file}: can't be written: {error.strerror}") from error
        self._writer = Writer(self._stream, compression=CompressionType.NONE, use_chunking=False)
        self._writer.start(profile="tjscan")
        self._channels = {topic: self._channel(topic, name) for topic, name in _TOPICS.items()}
        self._start_ns, self._now = time.time_ns(), 0.0
        self._stream.flush()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._writer.finish()
        self._sync()
        self._stream.close()

    def view(self, view: View) -> None:
        """Write the flange pose and the raw profile, before anybody tries to read it."""
        self._now = view.time
        substep = {"index": view.index, "substep": str(view.substep)}
        self._write("/flange", {"frame_id": "b", "pose": _pose(view.T_b_f), **substep})
        profile = view.profile
        columns = [profile.x_s, np.zeros(len(profile)), profile.z_s]
        names = ["x", "y", "z"]
        if profile.intensity is not None:
            columns.append(profile.intensity)
            names.append("intensity")
        self._write(
            "/profile",
            {
                "frame_id": "b",
                "pose": _pose(view.T_b_s),
                "point_stride": 8 * len(names),
                "fields": [
                    {"name": name, "offset": 8 * i, "type": _FLOAT64}
                    for i, name in enumerate(names)
                ],
                "data": b64encode(np.column_stack(columns).tobytes()).decode("ascii"),
                **substep,
            },
        )

    def section(self, scan: Scan) -> None:
        """Write a finished section and bring all of it to the disk."""
        self._write(
            "/section",
            {
                "frame_id": "b",
                "index": scan.view.index,
                "points": scan.points_b.tolist(),
                "T_b_g": scan.T_b_g.tolist(),
                "T_b_t": scan.T_b_t.tolist(),
            },
        )
        self._sync()

    def event(self, name: str, detail: str) -> None:
        """Write what happened out of the ordinary."""
        self._write("/event", {"name": name, "detail": detail})

    def _channel(self, topic: str, schema: str) -> int:
        text = json.dumps({"title": schema, "type": "object", "properties": _SCHEMAS[schema]})
        schema_id = self._writer.register_schema(schema, "jsonschema", text.encode())
        return self._writer.register_channel(topic, "json", schema_id)

    def _write(self, topic: str, message: dict[str, Any]) -> None:
        """Append a message, stamped with the start of the recording plus the arm's clock."""
        now = self._start_ns + round(1e9 * self._now)
        sec, nsec = divmod(now, 10**9)
        message = {"timestamp": {"sec": sec, "nsec": nsec}, **message}
        try:
            self._writer.add_message(
                self._channels[topic],
                log_time=now,
                publish_time=now,
                data=json.dumps(message).encode(),
            )
            self._stream.flush()
        except OSError as error:
            raise RecordingError(f"{self._file}: can't be written: {error.strerror}") from error

    def _sync(self) -> None:
        self._stream.flush()
        os.fsync(self._stream.fileno())


def _pose(T: Array) -> dict[str, dict[str, float]]:
    """A pose in the words of the Foxglove schemas."""
    quaternion = Rotation.from_matrix(T[:3, :3]).as_quat()
    return {
        "position": dict(zip("xyz", T[:3, 3].tolist(), strict=True)),
        "orientation": dict(zip("xyzw", quaternion.tolist(), strict=True)),
    }
