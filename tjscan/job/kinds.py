"""Which kind of file somebody gave, for one that is not what was asked for."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any, Final


@dataclass(frozen=True, slots=True)
class FileKind:
    """A kind of TOML file, told by its tables.

    Parameters
    ----------
    word : str
        Chooses it on the command line.
    name : str
        With its article.
    model : str
        Its model: ``module:class``.
    telling_tables : frozenset of str
        Tables or keys that stand in every such file, and all of them in no other; none where
        files of that kind are not told from others.
    use : str
        What such a file is for.
    """

    word: str
    name: str
    model: str
    telling_tables: frozenset[str]
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
        "tjscan.runs.chain.settings:ChainFile",
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
    """Kind of a file that is not of the kind that was asked for; None where its tables tell none.

    Parameters
    ----------
    tables : collection of str
        Tables and keys of the file.
    known : collection of str
        Tables and keys of the kind that was asked for.
    """
    told = (kind for kind in FILE_KINDS if kind.telling_tables <= set(tables))
    kind = next(told, None)
    return None if kind is None or kind.telling_tables <= set(known) else kind
