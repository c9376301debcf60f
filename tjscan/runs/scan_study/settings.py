"""What a scan of a study is made from: its job and its joint, whole."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Self

from tjscan.core.config import validate, written
from tjscan.job import JobFile
from tjscan.joint.file import JointFile
from tjscan.study.trial import canonical


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """The settings of one scan.

    Parameters
    ----------
    job : JobFile
        The resolved job.
    joint : JointFile
        Its joint.
    """

    job: JobFile
    joint: JointFile

    def to_json(self) -> str:
        """Canonical JSON."""
        return canonical(
            {
                "job": written(self.job),
                "joint": self.joint.model_dump(mode="json"),
            }
        )

    @classmethod
    def from_json(cls, text: str) -> Self:
        """What `to_json` wrote."""
        data = json.loads(text)
        return cls(validate(JobFile, data["job"]), validate(JointFile, data["joint"]))
