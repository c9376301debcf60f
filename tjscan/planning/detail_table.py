"""The table of joint details, as the user's code or drawing has it; nothing has a default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le, MinLen
from pydantic import AfterValidator

from tjscan.core.units import DEG, MM
from tjscan.core.units import SettingsTable as Table
from tjscan.planning.window import filled_window

Angle = Annotated[float, Ge(0), Le(180)]
Length = Annotated[float, Ge(0), Le(200)]


@dataclass(frozen=True, slots=True, kw_only=True)
class JointDetail(Table):
    """A row of the table ``[[detail]]``: a joint detail as the user's code or drawing has it.

    Parameters
    ----------
    name : str
        Of the detail.
    dihedral : tuple of float
        Window of the local dihedral angle in which it may be used; those of two may overlap.
    groove_angle : tuple of float
        Window of the angle between bevel and leg, radians.
    root_opening : tuple of float
        Window of an open root, metres.
    size : tuple of float
        Window of the distance from the middle of p3 and p4 to the line from p2 to g, metres.
    """

    name: Annotated[str, MinLen(1)]
    dihedral: Annotated[tuple[Angle, Angle], AfterValidator(filled_window), DEG]
    groove_angle: Annotated[tuple[Angle, Angle], AfterValidator(filled_window), DEG]
    root_opening: Annotated[tuple[Length, Length], AfterValidator(filled_window), MM]
    size: Annotated[tuple[Length, Length], AfterValidator(filled_window), MM]
