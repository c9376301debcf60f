"""The kinds of TOML files, and how a file of another kind is recognised."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class FileKind:
    """A kind of TOML file, recognised by its tables.

    Parameters
    ----------
    word : str
        Chooses it on the command line.
    name : str
        With its article.
    own_tables : frozenset of str
        Tables or keys that every such file has, and that no file of another kind has together.
    use : str
        What such a file is for.
    """

    word: str
    name: str
    own_tables: frozenset[str]
    use: str


FILE_KINDS: Final = (
    FileKind(
        "joint",
        "a joint",
        frozenset({"leg", "brace"}),
        "a job names it under joint.file",
    ),
    FileKind(
        "chain",
        "a chain of a calibration and a scan",
        frozenset({"calibrate", "scan"}),
        "run it with 'tjscan chain'",
    ),
    FileKind(
        "scan",
        "a job of a scan",
        frozenset({"scan"}),
        "run it with 'tjscan scan'",
    ),
    FileKind(
        "crawl",
        "a job of a crawler",
        frozenset({"vehicle", "weld"}),
        "run it with 'tjscan crawl run'",
    ),
    FileKind(
        "tow",
        "a job of towing vehicles",
        frozenset({"area", "seam"}),
        "run it with 'tjscan tow run'",
    ),
    FileKind(
        "recorded",
        "a job of a calibration from recorded profiles",
        frozenset({"recorded"}),
        "run it with 'tjscan calibrate'",
    ),
    FileKind(
        "calibrate",
        "a job of a calibration",
        frozenset({"board"}),
        "run it with 'tjscan calibrate'",
    ),
    FileKind(
        "study",
        "a study",
        frozenset({"job"}),
        "run it with 'tjscan study'",
    ),
    FileKind(
        "wps",
        "a welding procedure specification",
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
