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
    """Complete settings of one scan of a study: its job and its joint.

    Parameters
    ----------
    job : ScanJob
        The resolved job.
    joint : JointFile
        Its joint.
    """

    job: ScanJob
    joint: JointFile

    def to_canonical_json_text(self) -> str:
        """The settings as canonical JSON text."""
        return canonical_json(
            {
                "job": table_to_dict(self.job),
                "joint": self.joint.model_dump(mode="json"),
            }
        )

    @classmethod
    def from_json_text(cls, text: str) -> Self:
        """Read the settings from the text that `to_canonical_json_text` gave."""
        data = json.loads(text)
        return cls(validate_table(ScanJob, data["job"]), validate_table(JointFile, data["joint"]))
