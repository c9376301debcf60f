"""The layout for Foxglove shows topics and fields that recordings have."""

import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from tjscan.crawler.journal import CrawlCycle
from tjscan.recording.foxglove import PROFILE_TOPIC
from tjscan.recording.journal import LOG_TOPIC
from tjscan.scanning.recording import JOINTS_TOPIC, SCENE_TOPIC
from tjscan.towing.journal import TowCycle

LAYOUT = json.loads(
    (Path(__file__).parents[2] / "examples" / "foxglove-layout.json").read_text(encoding="utf-8")
)
PANELS: dict[str, Any] = LAYOUT["configById"]
CYCLES: dict[str, type] = {"/crawl/cycle": CrawlCycle, "/tow/cycle": TowCycle}


def plotted_paths() -> list[str]:
    return [path["value"] for panel in PANELS.values() for path in panel.get("paths", ())]


@pytest.mark.parametrize("path", plotted_paths())
def test_what_is_plotted_is_recorded(path: str) -> None:
    topic, _, field = path.partition(".")
    if topic == JOINTS_TOPIC.name:
        assert re.fullmatch(r"joints\[[0-5]\]\.position", field)
    else:
        assert field in {one.name for one in fields(CYCLES[topic])}


def test_what_is_drawn_is_recorded() -> None:
    assert set(PANELS["3D!scan"]["topics"]) == {PROFILE_TOPIC.name, SCENE_TOPIC.name}
    assert PANELS["RosOut!log"]["topicToRender"] == LOG_TOPIC.name


def test_every_panel_is_in_the_layout() -> None:
    placed = json.dumps([LAYOUT["layout"], PANELS["Tab!plots"]])
    assert all(f'"{name}"' in placed for name in PANELS)
