"""``tjscan schema``."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from tjscan.job.kinds import FileKind

MODELS_OF_KINDS: Final = {
    "joint": "tjscan.joint.file:JointFile",
    "chain": "tjscan.runs.chain:ChainFile",
    "scan": "tjscan.job.files:ScanJob",
    "crawl": "tjscan.job.crawl.job:CrawlJob",
    "tow": "tjscan.job.tow.job:TowJob",
    "recorded": "tjscan.job.files:RecordedJob",
    "calibrate": "tjscan.job.files:CalibrationJob",
    "study": "tjscan.study.file:StudyFile",
    "wps": "tjscan.planning.wps:WeldingProcedure",
}
"""Model of each of `tjscan.job.kinds.FILE_KINDS`, by its word: it is imported when it is used."""


def schema(kind: str | None = None) -> None:
    """Print the JSON schema of a kind of file, for editors that complete and check TOML files.

    A file names its schema in its first line: ``#:schema ./scan.schema.json``. Without a kind, the
    kinds are listed.

    Parameters
    ----------
    kind
        The kind of file, such as scan.
    """
    from json import dumps

    from tjscan.cli.output.console import print_table
    from tjscan.core.errors import ConfigurationError, nearest_word
    from tjscan.job.kinds import FILE_KINDS

    if kind is None:
        print_table([(found.word, found.name, found.use) for found in FILE_KINDS])
        return
    kinds = {found.word: found for found in FILE_KINDS}
    if kind not in kinds:
        raise ConfigurationError(
            f"there is no kind of file {kind!r}; did you mean: {nearest_word(kind, list(kinds))}? "
            f"Known: {', '.join(kinds)}"
        )
    print(dumps(json_schema_of_kind(kinds[kind]), indent=1))


def json_schema_of_kind(kind: FileKind) -> dict[str, Any]:
    """The JSON schema of files of a kind."""
    from tjscan.core.json_schema import json_schema_of

    model = EntryPoint(kind.word, MODELS_OF_KINDS[kind.word], "tjscan.file").load()
    return json_schema_of(model, kind.name)
