"""One scan of a study, whole in itself: it can be sent to any machine."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

from tjscan.core.config import validate
from tjscan.core.version import VERSION
from tjscan.job import JobFile
from tjscan.joint.definition import JointDefinition
from tjscan.joint.file import JointFile

Value = bool | int | float | str
"""What a cell of the table holds."""


@dataclass(frozen=True)
class Task:
    """One scan to make.

    Parameters
    ----------
    index : int
        Its row in the table.
    inputs : mapping
        What was varied, by dotted key, and what followed from rules.
    job, joint : str
        The resolved job and the joint's file, as canonical JSON.
    """

    index: int
    inputs: Mapping[str, Value]
    job: str
    joint: str

    @classmethod
    def of(cls, index: int, inputs: Mapping[str, Value], job: JobFile, joint: JointFile) -> Self:
        """The task of a resolved job and its joint."""
        return cls(
            index,
            dict(inputs),
            canonical(job.model_dump(mode="json", exclude_none=True)),
            canonical(joint.model_dump(mode="json")),
        )

    @cached_property
    def key(self) -> str:
        """Tells this scan from every other: a hash of all that decides its result."""
        text = canonical([VERSION, dict(self.inputs), self.job, self.joint])
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    @property
    def job_file(self) -> JobFile:
        """The resolved job."""
        return validate(JobFile, json.loads(self.job))

    @property
    def joint_definition(self) -> JointDefinition:
        """The joint, in metres and radians."""
        return validate(JointFile, json.loads(self.joint)).definition("joint")

    def to_json(self) -> str:
        """One line."""
        return canonical(
            {
                "index": self.index,
                "inputs": dict(self.inputs),
                "job": json.loads(self.job),
                "joint": json.loads(self.joint),
            }
        )

    @classmethod
    def from_json(cls, line: str) -> Self:
        """What `to_json` wrote."""
        data = json.loads(line)
        return cls(data["index"], data["inputs"], canonical(data["job"]), canonical(data["joint"]))


def canonical(data: Any) -> str:
    """JSON that is the same for the same data."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
