"""One run of a study, whole in itself: it can be sent to any machine."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

from tjscan.core.version import VERSION

Value = bool | int | float | str
"""What a cell of the table holds."""


@dataclass(frozen=True)
class Trial:
    """One run of a study to make: its row in the table, inputs, task and settings.

    Parameters
    ----------
    index : int
        Its row in the table.
    inputs : mapping
        What was varied, by dotted key, and what followed from that.
    task : str
        Which algorithm runs; see `tjscan.core.registry.TASKS`.
    settings : str
        Everything that it needs, as canonical JSON.
    """

    index: int
    inputs: Mapping[str, Value]
    task: str
    settings: str

    @cached_property
    def hash_key(self) -> str:
        """Hash of all that decides the run's result; tells it from every other run."""
        text = canonical_json([VERSION, dict(self.inputs), self.task, self.settings])
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    def to_json_line(self) -> str:
        """The trial as one line of JSON."""
        return canonical_json(
            {
                "index": self.index,
                "inputs": dict(self.inputs),
                "task": self.task,
                "settings": json.loads(self.settings),
            }
        )

    @classmethod
    def from_json_line(cls, line: str) -> Self:
        """Read a trial from the line that `to_json_line` gave.

        Raises
        ------
        ValueError, KeyError, TypeError
            If the line is no trial.
        """
        data = json.loads(line)
        return cls(data["index"], data["inputs"], data["task"], canonical_json(data["settings"]))


def canonical_json(data: Any) -> str:
    """JSON text that is always the same for the same data."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
