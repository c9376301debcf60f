"""What scans leave, as arrays: a scan's result, and its recording; both show themselves."""

from __future__ import annotations

from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from tjscan.core.frames import Array, array_dataclass, readonly_copy

if TYPE_CHECKING:
    from tjscan.core.display import Picture
    from tjscan.groove.measured import MeasuredSection
    from tjscan.laser.profile import Profile
    from tjscan.result.summary import ScanSummary

File = str | PathLike[str]

MOST_PROFILES_PLOTTED: Final = 9
"""Profiles of a recording that are drawn."""


@array_dataclass
class Scan:
    """A scanned groove, as a run directory holds it; all arrays are in one frame.

    Parameters
    ----------
    directory : Path
        The run directory.
    frame : str
        Letter of the frame: j, the joint's, or b, the robot's base.
    points : ndarray, shape (n, 5, 3)
        p1 to p5 of every section, metres.
    T_r_g : ndarray, shape (n, 4, 4)
        Pose of the frame g of every section.
    measures : ndarray, shape (n, 4)
        Groove angle (radians), root width, depth (metres) and area (m²).
    sigmas : ndarray, shape (n, 4)
        Their standard deviations.
    cloud : ndarray, shape (m, 3)
        All points of the sections' profiles, metres.
    sections : tuple of MeasuredSection
        The sections one by one, with their covariances.
    summary : ScanSummary
        The scan in a few numbers, in the units that their names state.
    """

    directory: Path
    frame: str
    points: Array
    T_r_g: Array
    measures: Array
    sigmas: Array
    cloud: Array
    sections: tuple[MeasuredSection, ...]
    summary: ScanSummary

    @classmethod
    def read(cls, directory: File) -> Scan:
        """Read a finished run directory, of one scan or stitched.

        Raises
        ------
        ConfigurationError
            If it holds no finished run, or its files are damaged.
        """
        from tjscan.result.directory import SECTIONS_FILE
        from tjscan.result.shapes import read_finished_summary, read_run_shape
        from tjscan.result.table import read_sections_csv

        folder = Path(directory)
        summary, shape = read_finished_summary(folder), read_run_shape(folder)
        sections = read_sections_csv(folder / SECTIONS_FILE)
        return cls(
            folder,
            summary.frame,
            np.array([section.points for section in sections]),
            np.array([section.T_r_g for section in sections]),
            np.array([section.measures for section in sections]),
            np.array([section.sigmas for section in sections]),
            np.empty((0, 3)) if shape.points is None else shape.points,
            sections,
            summary,
        )

    def to_pandas(self) -> Any:
        """Table of the sections as a DataFrame of pandas.

        Its columns are those of ``tjscan export --to csv``: their names end in the unit, such as
        ``root_width_mm``, and `docs/export.md` states what each is.

        Raises
        ------
        ConfigurationError
            If pandas is not installed.
        """
        from tjscan.core.display import to_data_frame
        from tjscan.result.section import columns_of_sections

        return to_data_frame(columns_of_sections(self.sections))

    def plot(self) -> Picture:
        """Draw the groove in space, and the measures along it with two standard deviations."""
        from tjscan.core.display import Picture
        from tjscan.result.picture import draw_groove_overview

        name = self.directory.resolve().name
        return Picture(
            draw_groove_overview(self.sections, self.cloud, frame=self.frame, title=name)
        )

    def _repr_html_(self) -> str:
        from tjscan.core.display import rows_to_html
        from tjscan.result.directory import SCAN_PICTURE
        from tjscan.result.summary import summary_in_words

        name = self.directory.resolve().name
        rows = [("frame", self.frame), *summary_in_words(self.summary)]
        return rows_to_html(name, rows, self.directory / SCAN_PICTURE)


class Recording:
    """What a scan recorded: every profile, and where the arm was.

    Parameters
    ----------
    path : path
        A run directory, or one file of its recording.

    Attributes
    ----------
    profiles : tuple of Profile
        Every profile in the order taken, in frame s, metres.

    Raises
    ------
    ConfigurationError
        If there is none.
    RecordingError
        If it is of another program, or damaged.
    """

    def __init__(self, path: File) -> None:
        from tjscan.scanning.recording import read_views

        self._name = Path(path).resolve().name
        self._views = tuple(read_views(Path(path)))
        self.profiles: tuple[Profile, ...] = tuple(view.profile for view in self._views)

    @cached_property
    def section_numbers(self) -> NDArray[np.int64]:
        """Number of the section that each profile was taken for, shape (n,)."""
        numbers = np.array([view.index for view in self._views], dtype=np.int64)
        numbers.setflags(write=False)
        return numbers

    @cached_property
    def q(self) -> Array:
        """Joint angles of the arm at each profile, shape (n, 6), radians."""
        return readonly_copy([view.q for view in self._views])

    @cached_property
    def T_b_f(self) -> Array:
        """Poses of the flange in the base frame at each profile, shape (n, 4, 4), metres."""
        return readonly_copy([view.T_b_f for view in self._views])

    @cached_property
    def T_b_s(self) -> Array:
        """Poses of the sensor in the base frame at each profile, shape (n, 4, 4), metres."""
        return readonly_copy([view.T_b_s for view in self._views])

    @cached_property
    def times(self) -> Array:
        """Time of each profile on the clock of the arm, shape (n,), seconds."""
        return readonly_copy([view.time for view in self._views])

    def __len__(self) -> int:
        return len(self._views)

    def to_pandas(self) -> Any:
        """Table of the profiles as a DataFrame of pandas.

        A row for each: section and substep, time in seconds, points that are there, joint angles
        in degrees, and where the sensor's origin was in the base frame, in mm.

        Raises
        ------
        ConfigurationError
            If pandas is not installed.
        """
        from tjscan.core.display import to_data_frame

        columns: dict[str, Any] = {
            "section": self.section_numbers,
            "substep": [str(view.substep) for view in self._views],
            "time_s": self.times,
            "points": [int(np.isfinite(profile.z_s).sum()) for profile in self.profiles],
        }
        for k, angles in enumerate(np.degrees(self.q).T, start=1):
            columns[f"q{k}_deg"] = angles
        for letter, along in zip("xyz", 1e3 * self.T_b_s[:, :3, 3].T, strict=True):
            columns[f"sensor_{letter}_mm"] = along
        return to_data_frame(columns)

    def plot(self) -> Picture:
        """Draw profiles in the laser plane, nine at most, with what is read in them."""
        from tjscan.core.display import Picture
        from tjscan.groove.settings import DEFAULT_SETTINGS
        from tjscan.result.picture import draw_profiles_with_fits
        from tjscan.result.readings import measure_grooves

        count = min(len(self), MOST_PROFILES_PLOTTED)
        chosen = np.unique(np.linspace(0, len(self) - 1, count, dtype=int))
        profiles = {
            f"profile {k + 1}: section {self._views[k].index}": self._views[k].profile
            for k in chosen.tolist()
        }
        readings = list(measure_grooves(profiles, DEFAULT_SETTINGS))
        return Picture(draw_profiles_with_fits(readings, DEFAULT_SETTINGS))

    def _repr_html_(self) -> str:
        from tjscan.core.display import rows_to_html

        sections, times = np.unique(self.section_numbers), self.times
        rows = [
            ("profiles", f"{len(self)}, of {len(sections)} sections"),
            ("time", f"{np.ptp(times) if len(times) else 0.0:.1f} s on the arm's clock"),
        ]
        return rows_to_html(self._name, rows)
