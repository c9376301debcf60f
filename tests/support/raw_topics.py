"""Topics of plain JSON: what other versions, or damage, may have written."""

from __future__ import annotations

import json
from typing import Any

from tjscan.recording.topic import Topic


def raw_topic(name: str, schema: str) -> Topic[dict[str, Any]]:
    """A topic whose messages are dictionaries, written as they are."""
    return Topic(
        name,
        schema,
        "json",
        json.dumps({"type": "object", "title": schema, "properties": {}}).encode(),
        lambda fields: json.dumps(fields).encode(),
        json.loads,
    )
