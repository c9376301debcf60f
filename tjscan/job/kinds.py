"""Which kind of file somebody gave, for one that is not what was asked for."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class FileKind:
    """A kind of TOML file, told by its tables.

    Parameters
    ----------
    name : str
        With its article.
    telling_tables : frozenset of str
        Tables or keys that stand in every such file, and all of them in no other.
    use : str
        What such a file is for.
    """

    name: str
    telling_tables: frozenset[str]
    use: str


FILE_KINDS: Final = (
    FileKind("a joint", frozenset({"leg", "brace"}), "a job names it under joint.file"),
    FileKind("a job of a scan", frozenset({"scan"}), "run it with 'tjscan scan'"),
    FileKind(
        "a job of a crawler", frozenset({"vehicle", "weld"}), "run it with 'tjscan crawl run'"
    ),
    FileKind(
        "a job of towing vehicles", frozenset({"cable", "seam"}), "run it with 'tjscan tow run'"
    ),
    FileKind("a job of a calibration", frozenset({"board"}), "run it with 'tjscan calibrate'"),
    FileKind("a study", frozenset({"job"}), "run it with 'tjscan study'"),
)


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
