"""The places that a joint is scanned from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt
from pydantic import Field

from tjscan.core.units import LIST_OR_WORD_IN_FILE, MM, PoseSettings
from tjscan.scanning.target import ScanDirection


@dataclass(frozen=True, slots=True, kw_only=True)
class StationPoseSettings(PoseSettings):
    """Name of a station, and the pose of the arm's base there in frame w.

    Parameters
    ----------
    name : str
        The station's name, and that of its folder.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]


@dataclass(frozen=True, slots=True, kw_only=True)
class StationSettings(StationPoseSettings):
    """The table [[station]]: about where the arm's base stands in frame w, and its start poses.

    Parameters
    ----------
    direction : ScanDirection, optional
        As in [scan], which holds where this is left out.
    length : float, optional
        As in [scan], metres.
    sections : int, optional
        As in [scan].
    first, second : PoseSettings
        The taught poses of the flange, in this station's frame b.
    """

    direction: Annotated[ScanDirection, LIST_OR_WORD_IN_FILE] | None = None
    length: Annotated[float | None, Gt(0), MM] = None
    sections: Annotated[int | None, Ge(3)] = None
    first: PoseSettings
    second: PoseSettings


def casefolded_name(name: str) -> str:
    """Station name without upper case, as folders of some systems and options have it."""
    return name.casefold().replace("-", "_")
