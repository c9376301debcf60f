"""What a scan of a study is made from: its job and its joint, whole."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Self

from tjscan.core.config import table_to_dict, validate_table
from tjscan.job import ScanJob
from tjscan.joint.file import JointFile
from tjscan.study.trial import canonical_json


@dataclass(frozen=True, slots=True)
class StudyScanSettings:
    """The settings of one scan.

    Parameters
    ----------
    job : ScanJob
        The resolved job.
    joint : JointFile
        Its joint.
    """

    job: ScanJob
    joint: JointFile

    def to_json(self) -> str:
        """Canonical JSON."""
        return canonical_json(
            {
                "job": table_to_dict(self.job),
                "joint": self.joint.model_dump(mode="json"),
            }
        )

    @classmethod
    def from_json(cls, text: str) -> Self:
        """What `to_json` wrote."""
        data = json.loads(text)
        return cls(validate_table(ScanJob, data["job"]), validate_table(JointFile, data["joint"]))
