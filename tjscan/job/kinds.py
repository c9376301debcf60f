"""The kinds of TOML files, and how a file of another kind is recognised."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any, Final


@dataclass(frozen=True, slots=True)
class FileKind:
    """A kind of TOML file, recognised by its tables.

    Parameters
    ----------
    word : str
        Chooses it on the command line.
    name : str
        With its article.
    model : str
        Its model: ``module:class``.
    own_tables : frozenset of str
        Tables or keys that every such file has, and that no file of another kind has together.
    use : str
        What such a file is for.
    """

    word: str
    name: str
    model: str
    own_tables: frozenset[str]
    use: str

    def json_schema(self) -> dict[str, Any]:
        """The JSON schema of such files."""
        from tjscan.core.json_schema import json_schema_of

        model = EntryPoint(self.word, self.model, "tjscan.file").load()
        return json_schema_of(model, self.name)


FILE_KINDS: Final = (
    FileKind(
        "joint",
        "a joint",
        "tjscan.joint.file:JointFile",
        frozenset({"leg", "brace"}),
        "a job names it under joint.file",
    ),
    FileKind(
        "chain",
        "a chain of a calibration and a scan",
        "tjscan.runs.chain:ChainFile",
        frozenset({"calibrate", "scan"}),
        "run it with 'tjscan chain'",
    ),
    FileKind(
        "scan",
        "a job of a scan",
        "tjscan.job.files:ScanJob",
        frozenset({"scan"}),
        "run it with 'tjscan scan'",
    ),
    FileKind(
        "crawl",
        "a job of a crawler",
        "tjscan.job.crawl.job:CrawlJob",
        frozenset({"vehicle", "weld"}),
        "run it with 'tjscan crawl run'",
    ),
    FileKind(
        "tow",
        "a job of towing vehicles",
        "tjscan.job.tow.job:TowJob",
        frozenset({"area", "seam"}),
        "run it with 'tjscan tow run'",
    ),
    FileKind(
        "recorded",
        "a job of a calibration from recorded profiles",
        "tjscan.job.files:RecordedJob",
        frozenset({"recorded"}),
        "run it with 'tjscan calibrate'",
    ),
    FileKind(
        "calibrate",
        "a job of a calibration",
        "tjscan.job.files:CalibrationJob",
        frozenset({"board"}),
        "run it with 'tjscan calibrate'",
    ),
    FileKind(
        "study",
        "a study",
        "tjscan.study.file:StudyFile",
        frozenset({"job"}),
        "run it with 'tjscan study'",
    ),
    FileKind(
        "wps",
        "a welding procedure specification",
        "tjscan.planning.wps:WeldingProcedure",
        frozenset({"arc", "bead"}),
        "plan with it: 'tjscan plan RUN --wps'",
    ),
)
"""The kinds of files that people write."""


def kind_of_other_file(tables: Collection[str], known: Collection[str]) -> FileKind | None:
    """Kind of a file that is not of the expected kind; None if its tables fit no other kind.

    Parameters
    ----------
    tables : collection of str
        Tables and keys of the file.
    known : collection of str
        Tables and keys of the expected kind.
    """
    kind = next((kind for kind in FILE_KINDS if kind.own_tables <= set(tables)), None)
    return None if kind is None or kind.own_tables <= set(known) else kind
