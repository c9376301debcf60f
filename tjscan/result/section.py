"""The one description of a section: each quantity's name, unit, meaning and printed digits.

Every file of sections and every chart of a report takes its names, units and numbers from
`SECTION_FIELDS`. A field that neighbouring sections decide, such as the groove's direction, is
marked as derived: it is written, and not read again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array, pose
from tjscan.core.provenance import LengthUnit
from tjscan.core.units import DEG, MM, MM2, NO_UNIT, FileUnit
from tjscan.groove.measured import MeasuredSection
from tjscan.groove.section import GrooveSection
from tjscan.result.directions import section_directions

IN_METRES: Final = {MM: FileUnit("m"), MM2: FileUnit("m2")}
"""What lengths and areas are given in if a file is in metres."""

UNIT_SYMBOLS: Final = {"deg": "°", "mm2": "mm²"}
CORNER_NUMBERS: Final = (2, 3, 4)
ZERO_OR_MORE: Final = (0.0, np.inf)
"""Bounds of a quantity that may be zero or more."""

WORD_SEPARATOR: Final = "; "
"""What separates several words of one text."""

TakeValues = Callable[[Sequence[MeasuredSection]], Any]
"""Takes the values of sections, in SI units and in their order along the groove."""

SINGLE_NUMBER_FIELDS: Final = ("azimuth", "work_angle", "rms", "model_probability", "root_opening")
"""Fields of a section that are a number each."""

WORD_FIELDS: Final = ("conditions", "absent")
"""Fields of a section that are several words each."""

UPPER_TRIANGLE: Final = np.triu_indices(3)
MEASURE_PAIRS: Final = np.triu_indices(4, 1)


@dataclass(frozen=True, slots=True)
class SectionQuantity:
    """A quantity of groove sections as files and charts hold it: name, meaning, unit and values.

    Parameters
    ----------
    name : str
        Of the quantity, as JSON has it.
    meaning : str
        What it is, in a sentence.
    unit : FileUnit
        Of the file, in millimetres and degrees.
    take : callable
        Gives the values of sections in their order along the groove, in SI units and its shape
        after the number of sections; the attribute of its name if left out.
    labels : tuple of str
        Names of its columns without their unit, one a number; its own name if left out.
    shape : tuple of int
        Of the value of one section.
    decimals : int or None
        That are printed in millimetres and degrees; None for six significant digits.
    bounds : tuple of float
        Least and largest value that a file may hold.
    derived : bool
        Whether it follows from the other fields.
    text : bool
        Whether its value is a text; several words of one are joined by ``; ``.
    later : bool
        Whether files of earlier versions lack it: it counts as left empty there.
    blank : bool
        Whether it may be left empty, as what is lacking in earlier versions always may.
    """

    name: str
    meaning: str
    unit: FileUnit
    take: TakeValues | None = None
    labels: tuple[str, ...] = ()
    shape: tuple[int, ...] = ()
    decimals: int | None = 4
    bounds: tuple[float, float] = (-np.inf, np.inf)
    derived: bool = False
    text: bool = False
    later: bool = False
    blank: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", self.labels or (self.name,))
        object.__setattr__(self, "blank", self.blank or self.later)

    @property
    def name_in_words(self) -> str:
        """The quantity's name in words."""
        return self.name.replace("_", " ")

    @property
    def chart_title(self) -> str:
        """The quantity's name and unit as the title of a chart."""
        symbol = UNIT_SYMBOLS.get(self.unit.suffix, self.unit.suffix)
        return f"{self.name_in_words}{symbol and f' / {symbol}'}"

    def unit_for_lengths(self, length: LengthUnit) -> FileUnit:
        """The quantity's unit in a file whose lengths are in mm or m."""
        return self.unit if length == "mm" else IN_METRES.get(self.unit, self.unit)

    def column_names(self, length: LengthUnit = "mm") -> tuple[str, ...]:
        """Names of the quantity's columns in a table, which end in its unit."""
        suffix = self.unit_for_lengths(length).suffix
        return tuple(f"{label}_{suffix}" if suffix else label for label in self.labels)

    def values_in_si_units(self, sections: Sequence[MeasuredSection]) -> NDArray[Any]:
        """The quantity's values of sections, numbers in SI units; several words are joined."""
        if self.take is not None:
            return np.asarray(self.take(sections))
        found = [getattr(section, self.name) for section in sections]
        if self.text:
            found = [one if isinstance(one, str) else WORD_SEPARATOR.join(one) for one in found]
        return np.array(found)

    def values_in_file_units(self, sections: Sequence[MeasuredSection]) -> Array:
        """The quantity's values of sections, in millimetres and degrees."""
        return np.asarray(self.values_in_si_units(sections) / self.unit.factor)

    def formatted_columns(
        self, sections: Sequence[MeasuredSection], length: LengthUnit = "mm"
    ) -> list[list[str]]:
        """Numbers of each section as text, in the order of the columns; empty if unknown."""
        unit = self.unit_for_lengths(length)
        decimals = self.decimals
        if decimals is not None:
            decimals += round(np.log10(unit.factor / self.unit.factor))
        rows = self.values_in_si_units(sections).reshape(len(sections), len(self.labels))
        return [
            [_formatted_value(value, unit.factor, decimals) for value in row]
            for row in rows.tolist()
        ]


def _formatted_value(value: float | str, factor: float, decimals: int | None) -> str:
    """A value in its unit, without a minus before a zero."""
    if isinstance(value, str):
        return value
    if np.isnan(value):
        return ""
    value /= factor
    if decimals is None:
        return f"{value:.6g}"
    text = f"{value:.{decimals}f}"
    return text if float(text) else f"{0:.{decimals}f}"


def absent_corners(
    sections: Sequence[MeasuredSection] | Sequence[GrooveSection],
) -> NDArray[np.bool_]:
    """Which of p2, p3 and p4 are buried, not there or not seen in n sections, shape (n, 3)."""
    names = ("p2", "p3", "p4")
    return np.array([[name in section.absent for name in names] for section in sections])


def lengths_along_groove(sections: Sequence[MeasuredSection]) -> Array:
    """Length in metres of the chain of groove origins up to each section, shape (n,).

    Taken between the origins as they are printed, so that a file agrees with itself.
    """
    origins = np.array([section.T_r_g[:3, 3] for section in sections]).reshape(-1, 3)
    steps = np.linalg.norm(np.diff(np.round(1e3 * origins, 4), axis=0), axis=1)
    return np.concatenate(([0.0], 1e-3 * steps.cumsum()))[: len(sections)]


def columns_of_sections(sections: Sequence[MeasuredSection]) -> dict[str, Any]:
    """Columns of all quantities of sections, by names that end in their unit, mm and degrees.

    Parameters
    ----------
    sections : sequence of MeasuredSection
        One or more, in their order along the groove; of one, nothing that neighbours decide.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        As tables hold them, to the last digit; NaN if a number is not known.
    """
    columns: dict[str, Any] = {}
    for field in (one for one in SECTION_FIELDS if len(sections) > 1 or not one.derived):
        values = field.values_in_si_units(sections)
        if field.unit is not NO_UNIT:
            values = values / field.unit.factor
        rows = values.reshape(len(sections), len(field.labels))
        columns |= zip(field.column_names(), rows.T, strict=True)
    return columns


def measure_columns(
    sections: Sequence[MeasuredSection],
) -> list[tuple[SectionQuantity, Array, Array]]:
    """Each measure with its values and standard deviations of n sections, in mm and degrees.

    A value is NaN if its root is not seen; the angle needs none.
    """
    rootless = absent_corners(sections).any(axis=1)
    columns = []
    for k, (field, sigma) in enumerate(zip(MEASURE_FIELDS, SIGMA_FIELDS, strict=True)):
        values = np.where(rootless & (k > 0), np.nan, field.values_in_file_units(sections))
        columns.append((field, values, sigma.values_in_file_units(sections)))
    return columns


def section_from_values(values: Mapping[str, Any]) -> MeasuredSection:
    """Build a section from the values of all quantities that are not derived.

    Parameters
    ----------
    values : mapping of str to ndarray, float or str
        Value by the field's name, in SI units and of the field's shape.
    """
    correlation = np.eye(4)
    correlation[MEASURE_PAIRS] = values["correlations"]
    correlation[MEASURE_PAIRS[::-1]] = correlation[MEASURE_PAIRS]
    sigmas = np.array([values[field.name] for field in SIGMA_FIELDS])
    covariances = np.empty((3, 3, 3))
    covariances[:, *UPPER_TRIANGLE] = values["covariances"]
    covariances[:, *UPPER_TRIANGLE[::-1]] = covariances[:, *UPPER_TRIANGLE]
    words = {name: str(values[name]).split(WORD_SEPARATOR) for name in WORD_FIELDS}
    plain: dict[str, Any] = {
        **{name: float(values[name]) for name in SINGLE_NUMBER_FIELDS},
        **{name: str(values[name]) for name in ("station", "model")},
        **{name: tuple(filter(None, found)) for name, found in words.items()},
    }
    return MeasuredSection(
        index=int(values["index"]),
        T_r_g=pose(np.transpose(values["axes"]), values["origin"]),
        points=values["points"],
        covariances=covariances,
        measures=np.array([values[field.name] for field in MEASURE_FIELDS]),
        measure_covariance=correlation * np.outer(sigmas, sigmas),
        shared_sigmas=np.broadcast_to(values["shared_sigmas"], 3),
        **plain,
    )


def _text_field(name: str, meaning: str) -> SectionQuantity:
    """A text that files of earlier versions lack."""
    return SectionQuantity(name, meaning, NO_UNIT, text=True, later=True)


def _sigma_field(name: str, meaning: str, unit: FileUnit, **more: Any) -> SectionQuantity:
    """Standard deviations, printed with six significant digits."""
    return SectionQuantity(name, meaning, unit, decimals=None, bounds=ZERO_OR_MORE, **more)


def _entry_getter(name: str, k: int) -> TakeValues:
    return lambda sections: np.array([getattr(section, name)[k] for section in sections])


def _measure_correlations(sections: Sequence[MeasuredSection]) -> Array:
    """Correlations of pairs of measures, shape (n, 6); zero if nothing varies."""
    covariances = np.array([s.measure_covariance[MEASURE_PAIRS] for s in sections]).reshape(-1, 6)
    scales = np.reshape([np.outer(s.sigmas, s.sigmas)[MEASURE_PAIRS] for s in sections], (-1, 6))
    zeros = np.zeros_like(covariances)
    ratios = np.divide(covariances, scales, out=zeros, where=scales > 0)
    return np.asarray(np.clip(ratios, -1, 1))


def _unit_vector_field(name: str, meaning: str, side: str) -> SectionQuantity:
    def take(sections: Sequence[MeasuredSection]) -> Any:
        return getattr(section_directions(sections), side)

    labels = tuple(f"{name}_{axis}" for axis in "xyz")
    return SectionQuantity(name, meaning, NO_UNIT, take, labels, (3,), 7, (-1, 1), derived=True)


MEASURE_MEANINGS: Final = {
    "groove_angle": (DEG, "angle between bevel and leg"),
    "root_width": (
        MM,
        "distance between p3 and p4: across the face of the root bead, or of the root opening "
        "if no bead is laid yet",
    ),
    "depth": (MM, "distance of the middle of p3 and p4 behind the brace's wall"),
    "area": (MM2, "of the quadrilateral of the origin of g, p2, p3 and p4"),
}
MEASURE_FIELDS: Final = tuple(
    SectionQuantity(
        name, meaning, unit, _entry_getter("measures", k), decimals=3 if unit is MM2 else 4
    )
    for k, (name, (unit, meaning)) in enumerate(MEASURE_MEANINGS.items())
)
"""What a section measures, in the order of `MeasuredSection.measures`."""

NAMES_OF_MEASURE_PAIRS: Final = tuple(combinations(MEASURE_MEANINGS, 2))
"""Names of two measures each, in the order of `MEASURE_PAIRS`."""

SIGMA_FIELDS: Final = tuple(
    _sigma_field(
        f"sigma_{name}", f"standard deviation of {name}", unit, take=_entry_getter("sigmas", k)
    )
    for k, (name, (unit, _)) in enumerate(MEASURE_MEANINGS.items())
)
"""Standard deviations of the measures, in the same order."""

SECTION_FIELDS: Final = (
    SectionQuantity(
        "index", "number of the section in its scan", NO_UNIT, decimals=0, bounds=ZERO_OR_MORE
    ),
    SectionQuantity(
        "station", "from where it was scanned; several joined by +", NO_UNIT, text=True
    ),
    SectionQuantity(
        "azimuth",
        "about the brace's axis from the crown; empty if no joint is known",
        DEG,
        bounds=(-360, 360),
        blank=True,
    ),
    SectionQuantity(
        "s",
        "length of the chain of groove origins up to here",
        MM,
        lengths_along_groove,
        derived=True,
    ),
    SectionQuantity(
        "points",
        "p1 to p5: end on the brace's wall, top of the bevel, root corner on the bevel, root "
        "corner on the leg, end on the leg",
        MM,
        labels=tuple(f"p{i}{axis}" for i in range(1, 6) for axis in "xyz"),
        shape=(5, 3),
    ),
    *MEASURE_FIELDS,
    SectionQuantity("work_angle", "from z of g to the middle of the groove angle", DEG),
    SectionQuantity(
        "rms", "of the profile's points about the fitted sides", MM, bounds=ZERO_OR_MORE
    ),
    SectionQuantity(
        "origin",
        "of frame g, where the lines along wall and leg meet",
        MM,
        lambda sections: np.array([section.T_r_g[:3, 3] for section in sections]),
        tuple(f"g{axis}" for axis in "xyz"),
        (3,),
    ),
    SectionQuantity(
        "axes",
        "x, y and z of frame g: square to the section's plane, up the brace's wall, and out of it",
        NO_UNIT,
        lambda sections: np.array([section.T_r_g[:3, :3].T for section in sections]),
        tuple(f"{name}_{axis}" for name in ("xg", "yg", "zg") for axis in "xyz"),
        (3, 3),
        7,
        bounds=(-1, 1),
    ),
    *SIGMA_FIELDS,
    SectionQuantity(
        "correlations",
        "of pairs of measures: " + ", ".join(f"{a} and {b}" for a, b in NAMES_OF_MEASURE_PAIRS),
        NO_UNIT,
        _measure_correlations,
        tuple(f"corr_{a}_{b}" for a, b in NAMES_OF_MEASURE_PAIRS),
        (6,),
        5,
        bounds=(-1, 1),
    ),
    SectionQuantity(
        "covariances",
        "of p2, p3 and p4, each as xx, xy, xz, yy, yz, zz; all components of uncertainty together",
        MM2,
        lambda sections: np.array(
            [section.covariances[:, *UPPER_TRIANGLE] for section in sections]
        ),
        tuple(
            f"cov_p{i}_{'xyz'[a]}{'xyz'[b]}"
            for i in CORNER_NUMBERS
            for a, b in zip(*UPPER_TRIANGLE, strict=True)
        ),
        (3, 6),
        None,
    ),
    _sigma_field(
        "corner_sigmas",
        "standard deviation of the places of p2, p3 and p4, all directions together",
        MM,
        labels=tuple(f"sigma_p{i}" for i in CORNER_NUMBERS),
        shape=(3,),
        derived=True,
    ),
    _unit_vector_field(
        "tangent", "unit vector along the groove at p3, counterclockwise", "tangent"
    ),
    _unit_vector_field("wall_normal", "unit vector out of the brace's wall at p2", "wall"),
    _unit_vector_field("bevel_normal", "unit vector out of the bevel between p2 and p3", "bevel"),
    _unit_vector_field("leg_normal", "unit vector out of the leg at p4", "leg"),
    _text_field("model", "form of groove that explains the profile best"),
    _text_field(
        "conditions",
        "what was found about the groove, such as tack, open root or seam weld beside; several "
        f"joined by {WORD_SEPARATOR.strip()}",
    ),
    _text_field(
        "absent",
        "corners that are buried, not there or not seen: what is given for them is where they may "
        f"be; several joined by {WORD_SEPARATOR.strip()}",
    ),
    SectionQuantity(
        "model_probability",
        "probability that the groove has this form, not another one of the same joint",
        NO_UNIT,
        bounds=(0, 1),
        later=True,
    ),
    SectionQuantity(
        "root_opening",
        "distance of an open root's edge from the leg, empty if the root is not open; its "
        "standard deviation is sigma_root_width",
        MM,
        bounds=ZERO_OR_MORE,
        later=True,
    ),
    _sigma_field(
        "shared_sigmas",
        "part of corner_sigmas that all sections of a scan share: they err alike by it; see "
        "uncertainty.json",
        MM,
        labels=tuple(f"sigma_shared_p{i}" for i in CORNER_NUMBERS),
        shape=(3,),
        later=True,
    ),
)
"""Every quantity of a section."""

UNDERIVED_SECTION_FIELDS: Final = tuple(field for field in SECTION_FIELDS if not field.derived)
"""What a section is made of again."""

FIELD_BY_NAME: Final = {field.name: field for field in SECTION_FIELDS}
