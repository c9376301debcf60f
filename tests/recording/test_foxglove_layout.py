"""The layout for Foxglove has panels that Foxglove knows, and shows what recordings hold."""

import json
import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import EXAMPLES, PAPER
from command import tjscan
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from tow_cycles import make_cycle

from tjscan.crawler.journal import CrawlCycle, CrawlRecording
from tjscan.crawler.method import TorchEstimate
from tjscan.crawler.phases import Phase
from tjscan.towing.journal import TowRecording
from tjscan.vehicle.vehicle import AT_REST, VehicleState

LAYOUT = json.loads((EXAMPLES / "foxglove-layout.json").read_text(encoding="utf-8"))
PANELS: dict[str, Any] = LAYOUT["configById"]
DRAWN: dict[str, Any] = PANELS["3D!scan"]

PLOTTED = [path["value"] for panel in PANELS.values() for path in panel.get("paths", ())]

PANEL_KEYS = {
    "3D": {"cameraState", "followMode", "followTf", "scene", "transforms", "topics", "layers"}
    | {"publish", "imageMode"},
    "Plot": {"paths", "showXAxisLabels", "showYAxisLabels", "showLegend", "legendDisplay"}
    | {"isSynced", "xAxisVal", "sidebarDimension", "foxglovePanelTitle"},
    "RosOut": {"searchTerms", "minLogLevel", "topicToRender", "nameFilter"},
    "Tab": {"activeTabIdx", "tabs"},
}
"""Keys that a panel's settings may hold here, as `foxglove.layouts` of foxglove-sdk 0.30 and the
open viewer Lichtblick name them; any other key a viewer passes over in silence."""

PATH_KEYS = {"value", "enabled", "timestampMethod", "label"}
TOPIC_KEYS = {"visible", "pointSize", "colorMode", "flatColor"}
CAMERA_KEYS = {"perspective", "distance", "phi", "thetaOffset", "targetOffset", "target"} | {
    *("targetOrientation", "fovy", "near", "far"),
}


@dataclass(frozen=True)
class Recorded:
    """A topic as any viewer reads it: the name of its schema, and its messages."""

    schema: str
    messages: list[Any]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recorded]:
    """Topics of a scan by the command line, and of the records of a crawl and a tow."""
    folder = tmp_path_factory.mktemp("runs")
    assert tjscan("scan", PAPER, "--out", folder / "scan", "--scan.sections", 3) == 0
    with CrawlRecording(folder / "crawl.mcap") as crawl:
        state, torch = VehicleState(0.0, AT_REST), TorchEstimate(0.0, 1e-3, 0.0)
        cycle = CrawlCycle(Phase.WELDING, 1, 0.01, state, AT_REST, torch, 0.0, 0.0, True, d=1e-3)
        crawl.record(cycle)
    with TowRecording(folder / "tow.mcap") as tow:
        tow.record(make_cycle(0.1))
    messages: defaultdict[tuple[str, str], list[Any]] = defaultdict(list)
    for file in (folder / "scan" / "scan.mcap", folder / "crawl.mcap", folder / "tow.mcap"):
        read_as_a_viewer(file, messages)
    return {topic: Recorded(schema, found) for (topic, schema), found in messages.items()}


def read_as_a_viewer(file: Path, messages: defaultdict[tuple[str, str], list[Any]]) -> None:
    protobuf = DecoderFactory()
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            decode = protobuf.decoder_for(channel.message_encoding, schema) or json.loads
            messages[channel.topic, schema.name].append(decode(message.data))


def at_path(message: Any, path: str) -> Any:
    """What a message path names within a message, such as ``.joints[0].position``."""
    for name, index in re.findall(r"\.(\w+)|\[(\d+)\]", path):
        if index:
            message = message[int(index)]
        else:
            message = message[name] if isinstance(message, dict) else getattr(message, name)
    return message


@pytest.mark.parametrize("path", PLOTTED)
def test_what_is_plotted_is_a_number_that_is_recorded(
    path: str, recorded: dict[str, Recorded]
) -> None:
    topic, field = re.fullmatch(r"(/[\w/]+)((?:\.\w+|\[\d+\])+)", path).groups()  # type: ignore[union-attr]
    for message in recorded[topic].messages:
        assert np.isfinite(at_path(message, field))


def test_what_is_drawn_is_recorded_in_schemas_that_a_viewer_draws(
    recorded: dict[str, Recorded],
) -> None:
    for topic, schema in (("/profile", PointCloud), ("/scene", SceneUpdate)):
        assert topic in DRAWN["topics"]
        assert recorded[topic].schema == schema.DESCRIPTOR.full_name
    assert len(DRAWN["topics"]) == 2
    log = recorded[PANELS["RosOut!log"]["topicToRender"]]
    assert log.schema == Log.DESCRIPTOR.full_name


def test_the_frames_of_what_is_drawn_lead_to_the_one_that_it_is_drawn_in(
    recorded: dict[str, Recorded],
) -> None:
    transforms = [one for message in recorded["/tf"].messages for one in message.transforms]
    parents = {one.child_frame_id: one.parent_frame_id for one in transforms}
    frames = {cloud.frame_id for cloud in recorded["/profile"].messages}
    frames |= {one.frame_id for scene in recorded["/scene"].messages for one in scene.entities}
    for frame in frames:
        while frame != DRAWN["followTf"]:
            frame = parents[frame]


@pytest.mark.parametrize("name", PANELS)
def test_a_viewer_knows_the_panel_and_every_key(name: str) -> None:
    panel = PANELS[name]
    assert set(panel) <= PANEL_KEYS[name.partition("!")[0]]
    assert all(set(path) == PATH_KEYS for path in panel.get("paths", ()))
    assert all(set(topic) <= TOPIC_KEYS for topic in panel.get("topics", {}).values())
    assert set(panel.get("cameraState", {})) <= CAMERA_KEYS


def test_every_panel_is_in_the_layout() -> None:
    placed = json.dumps([LAYOUT["layout"], PANELS["Tab!plots"]])
    assert all(f'"{name}"' in placed for name in PANELS)
    assert set(LAYOUT) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
