"""What a run has to show: what does not change, and what changes step by step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import nan
from types import MappingProxyType
from typing import Any, Final, Protocol, Self

import numpy as np

from tjscan.core.frames import Array
from tjscan.laser.profile import Profile
from tjscan.live.drawables import Drawable, Lines, Surface
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.settings import Solid

STATE_FACT: Final = "state"
"""The fact that shows what the run is doing, or asks."""
BUTTONS_FACT_NAME: Final = "press"
"""The fact that shows which buttons answer."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A quantity that the page colours by and plots.

    Parameters
    ----------
    name : str
        In words.
    unit : str
        Of its values; empty for a number.
    logarithmic : bool
        Whether its axis is.
    """

    name: str
    unit: str = ""
    logarithmic: bool = False

    @property
    def title(self) -> str:
        """Name with unit, as on an axis."""
        return f"{self.name} / {self.unit}" if self.unit else self.name


@dataclass(frozen=True, slots=True)
class Sample:
    """Values of measures at one place of the plot's axis.

    Parameters
    ----------
    x : float
        Place.
    values : mapping of str to float
        By the measures' names.
    sigmas : mapping of str to float
        Their standard deviations, as far as they are known.
    """

    x: float
    values: Mapping[str, float]
    sigmas: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def sigma(self, name: str) -> float:
        """Standard deviation of a measure; NaN if it is not known."""
        return self.sigmas.get(name, nan)


@dataclass(frozen=True, slots=True)
class PlaneCurve:
    """A profile in its own plane, millimetres: the points, and what was fitted to them.

    Parameters
    ----------
    across, up : ndarray, shape (n,)
        Of the points, as they are shown.
    fitted : ndarray, shape (k, 2)
        Corners of the polyline that was fitted; empty if none was.
    """

    across: Array
    up: Array
    fitted: Array = field(default_factory=lambda: np.empty((0, 2)))
    axes: tuple[str, str] = ("across / mm", "height / mm")

    @classmethod
    def of_profile(cls, profile: Profile) -> Self:
        """Return a profile as the sensor above sees it: what is deeper is farther down."""
        points = 1e3 * profile.points_s
        return cls(points[:, 0], -points[:, 2], axes=("x / mm", "−z / mm"))

    @classmethod
    def along_groove(cls, profile: Profile, corners_s: Array | None = None) -> Self:
        """Return a profile along the groove of a joint, the brace up, the leg down.

        Parameters
        ----------
        profile : Profile
        corners_s : ndarray, shape (k, 3), optional
            Corners that were fitted to it, metres.
        """
        corners = np.empty((0, 3)) if corners_s is None else corners_s
        points, fitted = (1e3 * one[:, [2, 0]] * (-1, 1) for one in (profile.points_s, corners))
        axes = ("−z / mm, towards the sensor", "x / mm, up the brace")
        return cls(points[:, 0], points[:, 1], fitted, axes)


@dataclass(frozen=True, slots=True)
class StateDiagram:
    """States in a column, the transitions between them, and the present state.

    Parameters
    ----------
    states : tuple of str
        From top to bottom.
    transitions : tuple of (str, str, str)
        From a state to another, and the event that leads there.
    now : str
        The present state.
    alarm : str
        State that every other may lead to; empty if there is none.
    """

    states: tuple[str, ...]
    transitions: tuple[tuple[str, str, str], ...]
    now: str
    alarm: str = ""

    def ways_from(self, state: str) -> list[tuple[str, str]]:
        """States that a state leads to, with all events that do so."""
        labels: dict[str, list[str]] = {}
        for start, end, label in self.transitions:
            if start == state:
                labels.setdefault(end, []).append(label)
        return [(end, ", ".join(events)) for end, events in labels.items()]


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What changed at once; what it does not name stays as it was.

    Parameters
    ----------
    label : str
        Of the step, in words: the slider of a recording shows it.
    drawn : mapping of str to drawable
        By their names, such as ``groove/12``.
    facts : mapping of str to str
        State in words, by what it is of.
    progress : float or None
        Share of the work that is done.
    samples : sequence of Sample
        For the plot.
    profile : PlaneCurve or None
        The newest profile.
    events : sequence of (str, str)
        Name and detail of what happened.
    table : sequence of sequences of str, or None
        The newest table, its head first.
    diagram : StateDiagram or None
        The states of the run, and which it is in.
    """

    label: str = ""
    drawn: Mapping[str, Drawable] = field(default_factory=lambda: MappingProxyType({}))
    facts: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    progress: float | None = None
    samples: Sequence[Sample] = ()
    profile: PlaneCurve | None = None
    events: Sequence[tuple[str, str]] = ()
    table: Sequence[Sequence[str]] | None = None
    diagram: StateDiagram | None = None


def merge_steps(steps: Sequence[Step]) -> Step:
    """Merge steps into one: of what has the same name the last one counts."""

    def newest(name: str) -> Any:
        values = (getattr(step, name) for step in reversed(steps))
        return next((value for value in values if value is not None), None)

    return Step(
        next((step.label for step in reversed(steps) if step.label), ""),
        {name: thing for step in steps for name, thing in step.drawn.items()},
        {name: text for step in steps for name, text in step.facts.items()},
        newest("progress"),
        [sample for step in steps for sample in step.samples],
        newest("profile"),
        [event for step in steps for event in step.events],
        newest("table"),
        newest("diagram"),
    )


@dataclass(frozen=True, slots=True, eq=False)
class SceneSetup:
    """What a run shows from its beginning to its end.

    Parameters
    ----------
    title : str
        Of the run.
    measures : tuple of Measure
        What may be coloured by and plotted, the most wanted first.
    plot_axis : str
        What the samples' x is, with its unit.
    plot_by_clock : bool
        Whether that axis is hours of a clock.
    arm : Kinematics or None
    solids : tuple of Solid
        What is about, in frame b.
    tool : tuple of Solid
        What the arm carries, in frame f.
    bodies : mapping of str to tuple of Solid
        What else moves, each in its own frame, placed by `BodyPose` steps of its name.
    see_through : tuple of str
        Which of them are.
    ghost : tuple of Lines or Surface
        What was designed, drawn faintly.
    look_at : ndarray, shape (3,)
        Middle of the picture.
    look_from : ndarray, shape (3,)
        Where it is seen from.
    """

    title: str
    measures: tuple[Measure, ...] = ()
    plot_axis: str = ""
    plot_by_clock: bool = False
    arm: Kinematics | None = None
    solids: tuple[Solid, ...] = ()
    tool: tuple[Solid, ...] = ()
    bodies: Mapping[str, tuple[Solid, ...]] = field(default_factory=lambda: MappingProxyType({}))
    see_through: tuple[str, ...] = ()
    ghost: tuple[Lines | Surface, ...] = ()
    look_at: Array = field(default_factory=lambda: np.zeros(3))
    look_from: Array = field(default_factory=lambda: np.array((2.0, -2.0, 1.5)))


@dataclass(frozen=True, slots=True, eq=False)
class RecordedShow:
    """What a recording has to show.

    Parameters
    ----------
    setting : Setting
        What does not change.
    steps : tuple of Step
        In their order.
    """

    setting: SceneSetup
    steps: tuple[Step, ...]


class Show(Protocol):
    """Turns what a run's journal receives into steps of the page."""

    @property
    def setting(self) -> SceneSetup:
        """What does not change."""

    def step_of_entry(self, entry: object) -> Step:
        """What an entry changes: nothing if it is of an unknown type."""
