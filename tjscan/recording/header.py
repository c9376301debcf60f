"""The head of a recording: the program that made it, and the job that it was made with."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from typing import Any, ClassVar, Final, Self

from tjscan.core.errors import RecordingError
from tjscan.core.version import PROGRAM_VERSION

PROGRAM_NAME: Final = "tjscan"
"""MCAP profile of every recording."""

FORMAT_VERSION: Final = 1
"""Number of the format that is written: one more whenever an older version can't read it."""

CHECKSUM_KEY: Final = "sha256"
"""Key of a metadata record: the SHA-256 of all others."""


@dataclass(frozen=True, slots=True)
class RecordingHeader:
    """Header of a recording: version of the program that made it, and version of the format.

    Parameters
    ----------
    version : str
        Of the program.
    format : int
        How it is written.
    messages_before : int
        Messages in the earlier parts of the recording.
    """

    record_name: ClassVar[str] = "tjscan.recording"
    """Name of its metadata record at the head of a recording."""

    version: str = PROGRAM_VERSION
    format: int = FORMAT_VERSION
    messages_before: int = 0

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> Self:
        """Header from a recording's metadata; raises ValueError if it is none.

        The header of another format is not checked any further: only its version is needed.
        """
        header = cls(metadata.get("version", ""), int(metadata.get("format", "")))
        if header.format != FORMAT_VERSION:
            return header
        _check_metadata(metadata)
        return replace(header, messages_before=int(metadata.get("messages_before", "")))

    @property
    def metadata(self) -> dict[str, str]:
        """The header as metadata of a recording: names and texts."""
        own = {name: str(value) for name, value in asdict(self).items()}
        return _add_checksum({"program": PROGRAM_NAME, **own})


@dataclass(frozen=True, slots=True)
class JobSnapshot:
    """The job of a run and the files beside it, as they were when it was recorded.

    Parameters
    ----------
    job, joint, calibration : str
        Text of the TOML files; empty if there is none.
    arm : str
        SHA-256 of the arm's URDF; empty if the job names a model instead.
    """

    record_name: ClassVar[str] = "tjscan.origin"
    """Name of its metadata record at the head of a recording."""

    job: str
    joint: str = ""
    calibration: str = ""
    arm: str = ""

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> Self:
        """Snapshot from a recording's metadata; raises ValueError if it was changed since."""
        _check_metadata(metadata)
        return cls(**{name: metadata.get(name, "") for name in cls.__slots__})

    @property
    def metadata(self) -> dict[str, str]:
        """The snapshot as metadata of a recording: names and texts."""
        return _add_checksum(asdict(self))


def _add_checksum(fields: Mapping[str, str]) -> dict[str, str]:
    return {**fields, CHECKSUM_KEY: _checksum_of(fields)}


def _check_metadata(metadata: Mapping[str, str]) -> None:
    if metadata.get(CHECKSUM_KEY) != _checksum_of(metadata):
        raise ValueError("the checksum of its head is another")


def _checksum_of(fields: Mapping[str, str]) -> str:
    others = {name: text for name, text in fields.items() if name != CHECKSUM_KEY}
    return sha256(json.dumps(others, sort_keys=True).encode()).hexdigest()


def job_snapshot_changes(before: JobSnapshot, now: JobSnapshot) -> Iterator[tuple[str, str]]:
    """Yield each key that differs between two job snapshots, and how.

    Keys of the job are its own; keys of the other files begin with ``joint.toml:``,
    ``calibration.toml:`` and ``arm.urdf``.

    Raises
    ------
    RecordingError
        If a text is no TOML.
    """
    yield from _differing_keys("", before.job, now.job)
    yield from _differing_keys("joint.toml: ", before.joint, now.joint)
    yield from _differing_keys("calibration.toml: ", before.calibration, now.calibration)
    if before.arm != now.arm:
        yield "arm.urdf", "another file than it was"


def _differing_keys(name: str, before: str, now: str) -> Iterator[tuple[str, str]]:
    try:
        old, new = (flatten_to_dotted_keys(tomllib.loads(text)) for text in (before, now))
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"what it was recorded with can't be read: {error}") from error
    for key in sorted(old.keys() | new.keys()):
        if old.get(key) != new.get(key):
            yield f"{name}{key}", f"was {old.get(key, 'not there')}, is {new.get(key, 'not there')}"


def flatten_to_dotted_keys(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten nested tables: ``{"scan": {"step_mm": 1}}`` becomes ``{"scan.step_mm": 1}``.

    Parameters
    ----------
    table : mapping
        As TOML gives it.
    prefix : str
        Put before every key.
    """
    flat: dict[str, Any] = {}
    for key, value in table.items():
        name = f"{prefix}{key}"
        is_table = isinstance(value, Mapping)
        flat |= flatten_to_dotted_keys(value, f"{name}.") if is_table else {name: value}
    return flat
