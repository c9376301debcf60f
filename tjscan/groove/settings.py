"""What a groove looks like, and how it is looked for: templates and settings.

A template has sides and the corners between them. Sides run from the brace's wall (or the first
plate) to the leg (or the second plate). A turn is positive in a valley and negative on a ridge, as
the sensor sees it. A new groove is a new value.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import Annotated, Final

from annotated_types import Ge, Gt, Le

from tjscan.core.units import MM, ChosenByName, SettingsTable

LEAST_SIDES: Final = 3


@dataclass(frozen=True, slots=True)
class SideModel:
    """Model of a groove's side: its name, length bounds, and how far it may be from straight.

    Parameters
    ----------
    name : str
        What it is called in messages.
    shortest, longest : float
        Bounds of its length, in metres; the first and the last side may run on.
    bend, twist : float
        How far its cross-section ``c2 s² + c3 s³`` may be from straight: standard deviations of
        c2, in 1/m, and of c3, in 1/m². A pipe of radius R cut across has c2 = 1 / (2 R).
    expected_bend : float, optional
        About which c2 scatters, in 1/m; None if it scatters about zero, and the side may as
        well be straight.
    bead : bool
        Whether it is the face of a weld bead, which may bulge or sag by a good part of its width.
    roughness : float
        How far its surface may lie off such a cross-section, in metres: beads side by side.
    """

    name: str
    shortest: float
    longest: float = 0.2
    bend: float = 0.0
    twist: float = 0.0
    expected_bend: float | None = None
    bead: bool = False
    roughness: float = 0.0


@dataclass(frozen=True, slots=True)
class TurnBounds:
    """Bounds of the angle by which one side turns to the next, in radians."""

    least: float
    most: float


@dataclass(frozen=True, slots=True)
class GrooveModel:
    """Model of a groove's shape: its sides and the turns between them.

    Parameters
    ----------
    name : str
    sides : tuple of SideModel
        At least three; the first and the last are the long outer ones.
    turns : tuple of TurnBounds
        One fewer: from each side to the next.
    across : TurnBounds
        From the first side to the last.
    alternatives : tuple of GrooveModel
        What such a groove may look like instead; the points decide.
    """

    name: str
    sides: tuple[SideModel, ...]
    turns: tuple[TurnBounds, ...]
    across: TurnBounds
    alternatives: tuple[GrooveModel, ...] = ()

    def __post_init__(self) -> None:
        if len(self.sides) < LEAST_SIDES or len(self.turns) != len(self.sides) - 1:
            raise ValueError("a groove has three sides or more, and a turn between each two")

    @property
    def has_section_points(self) -> bool:
        """Whether its corners are the five points of a section, which a scan needs."""
        return len(self.sides) == 4  # wall, bevel, root and leg


LEAST_OPENING_ANGLE: Final = radians(20)
LARGEST_OPENING_ANGLE: Final = radians(100)
"""Bounds of the angle between the two faces of any groove, in radians."""

_RIDGE_TURN: Final = TurnBounds(-radians(100), -radians(6))
_HALF_VALLEY_TURN: Final = TurnBounds(radians(8), radians(150))
_VALLEY_TURN: Final = TurnBounds(
    radians(180) - LARGEST_OPENING_ANGLE, radians(180) - LEAST_OPENING_ANGLE
)
_ROOT_FACE: Final = SideModel("root", 0.8e-3, 14e-3, bend=100.0, twist=8000.0, bead=True)

_WELD_TURN: Final = TurnBounds(radians(17), radians(150))
_KNEE_TURN: Final = TurnBounds(-radians(16), radians(16))
_WALL_SIDE: Final = SideModel("wall", 4e-3, bend=0.7)
_BEVEL_SIDE: Final = SideModel("bevel", 4e-3, 120e-3, bend=0.25)
_LEG_SIDE: Final = SideModel("leg", 4e-3, bend=5.0, twist=10.0)
_TEE_WALL_TO_LEG_TURN: Final = TurnBounds(radians(8), radians(150))

LEAST_FACE_TURN: Final = radians(15)
"""By how much the chord of a bead's face turns from the sides before and after it at least: what
turns by less goes on from them."""

FACE_BLUNTNESS: Final = 0.2
"""Share of its height by which the face of a bead may lie off a parabola."""

WELD_ROUGHNESS: Final = 0.5e-3
"""How far beads side by side leave one smooth surface, in metres."""

TEE_TWO_FACETS: Final = GrooveModel(
    "tee with two facets",
    (
        _WALL_SIDE,
        SideModel("upper bevel", 3e-3, 80e-3),
        # A shorter one can't be separated from a flank that light between the faces pulls in.
        SideModel("lower bevel", 6e-3, 80e-3),
        _ROOT_FACE,
        _LEG_SIDE,
    ),
    (_RIDGE_TURN, _KNEE_TURN, _HALF_VALLEY_TURN, _HALF_VALLEY_TURN),
    _TEE_WALL_TO_LEG_TURN,
)
"""The same with a bevel ground or cut in two facets."""

TEE_NO_ROOT: Final = GrooveModel(
    "tee without a root face",
    (_WALL_SIDE, _BEVEL_SIDE, _LEG_SIDE),
    (_RIDGE_TURN, _VALLEY_TURN),
    _TEE_WALL_TO_LEG_TURN,
)
"""The same if no face closes the root, or none is seen."""

TEE_PARTLY_FILLED: Final = GrooveModel(
    "partly filled tee",
    (
        _WALL_SIDE,
        SideModel("bevel", 2e-3, 120e-3, bend=0.25),
        # A narrower one looks like the face of a root.
        SideModel(
            "weld", 12e-3, 80e-3, bend=30.0, twist=300.0, bead=True, roughness=WELD_ROUGHNESS
        ),
        _LEG_SIDE,
    ),
    # A flank that turns by less into what is beside it has two facets.
    (_RIDGE_TURN, _WELD_TURN, _WELD_TURN),
    _TEE_WALL_TO_LEG_TURN,
)
"""The same with beads in it that hide the root: bevel and leg end at the weld's toes."""

TEE_GROOVE: Final = GrooveModel(
    "tee",
    (_WALL_SIDE, _BEVEL_SIDE, _ROOT_FACE, _LEG_SIDE),
    (_RIDGE_TURN, _HALF_VALLEY_TURN, _HALF_VALLEY_TURN),
    _TEE_WALL_TO_LEG_TURN,
    (TEE_TWO_FACETS, TEE_NO_ROOT, TEE_PARTLY_FILLED),
)
"""Tubular T-joint: wall, bevel, root and leg; five points."""

_PLATES_TURN: Final = TurnBounds(-radians(30), radians(30))
_FIRST_PLATE: Final = SideModel("plate", 4e-3, bend=0.3)
_OTHER_PLATE: Final = SideModel("other plate", 4e-3, bend=0.3)
# Cut or ground by hand, a bevel bows by a tenth of a millimetre in 20 mm.
_FIRST_BEVEL_SIDE: Final = SideModel("bevel", 3e-3, 80e-3, bend=1.0)
_OTHER_BEVEL_SIDE: Final = SideModel("other bevel", 3e-3, 80e-3, bend=1.0)
_BUTT_ROOT_SIDE: Final = SideModel("root", 0.8e-3, 45e-3, bend=100.0, twist=8000.0, bead=True)

BUTT_V_SHARP: Final = GrooveModel(
    "butt-v-sharp",
    (_FIRST_PLATE, _FIRST_BEVEL_SIDE, _OTHER_BEVEL_SIDE, _OTHER_PLATE),
    (_RIDGE_TURN, _VALLEY_TURN, _RIDGE_TURN),
    _PLATES_TURN,
)
"""Butt joint whose bevels, drawn on, meet in a sharp valley: three corners."""

BUTT_V: Final = GrooveModel(
    "butt-v",
    (_FIRST_PLATE, _FIRST_BEVEL_SIDE, _BUTT_ROOT_SIDE, _OTHER_BEVEL_SIDE, _OTHER_PLATE),
    (_RIDGE_TURN, _HALF_VALLEY_TURN, _HALF_VALLEY_TURN, _RIDGE_TURN),
    _PLATES_TURN,
    (BUTT_V_SHARP,),
)
"""Butt joint with a root face or with beads up to any height: four corners; three without."""

GROOVE_MODELS: Final = {model.name: model for model in (TEE_GROOVE, BUTT_V, BUTT_V_SHARP)}
"""The templates by name."""


@dataclass(frozen=True, slots=True)
class GrooveSettings(SettingsTable):
    """Settings for reading grooves: the table [groove].

    Parameters
    ----------
    model : GrooveModel
        What it looks like.
    noise : float
        Largest standard deviation of the range that is expected, in metres.
    minimum_points : int
        Fewest points of a profile that are worth a search.
    largest_sigma : float
        Largest standard deviation of a corner that is still an answer, in metres.
    largest_rms : float
        Largest deviation of the points from the fitted sides, in metres (rms).
    inlier_share : float
        Least share of a side's points that must lie on it.
    """

    model: Annotated[GrooveModel, ChosenByName(GROOVE_MODELS)] = TEE_GROOVE
    noise: Annotated[float, Ge(0.001), Le(5), MM] = 0.05e-3
    minimum_points: Annotated[int, Ge(20), Le(10_000)] = 80
    largest_sigma: Annotated[float, Gt(0), Le(10), MM] = 0.6e-3
    largest_rms: Annotated[float, Gt(0), Le(10), MM] = 0.15e-3
    inlier_share: Annotated[float, Gt(0), Le(1)] = 0.1

    def __post_init__(self) -> None:
        if not (self.noise > 0 and self.largest_sigma > 0 and self.largest_rms > 0):
            raise ValueError("noise, largest_sigma and largest_rms must be positive")

    @property
    def support_tolerance(self) -> float:
        """Distance from a hypothesis within which points support it, in metres."""
        return TOLERANCE_SIGMAS * self.noise


TOLERANCE_SIGMAS: Final = 4.0
"""The tolerance in expected standard deviations."""

DEFAULT_SETTINGS: Final = GrooveSettings()
