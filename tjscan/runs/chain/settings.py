"""The chain's file: its two jobs, and what both of their simulations share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Final

from annotated_types import Gt, Le
from pydantic import Field

from tjscan.core.config import StrictFileModel, read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.units import DEG, MM, SettingsTable
from tjscan.joint.tubes.fit import ArmRepeatability
from tjscan.study.file import flatten_to_dotted_keys

SHARED: Final = ("arm.", "laser.", "simulation.")
"""Tables that both jobs have in common: they are of one cell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewErrorSettings(SettingsTable):
    """The table [stitch]: what arm and laser err by from view to view, root mean square.

    Parameters
    ----------
    repeatability, angular_repeatability : float
        Of position and angle, metres and radians. An arm whose geometry is off errs by more than
        it does not repeat.
    """

    repeatability: Annotated[float, Gt(0), Le(5), MM] = 5e-5
    angular_repeatability: Annotated[float, Gt(0), Le(1), DEG.with_key("repeatability_deg")] = 1e-4


class ChainFile(StrictFileModel):
    """A chain: the job that calibrates, the job that scans, and what is set in both.

    Parameters
    ----------
    calibrate, scan : str
        Paths of the jobs, counted from the file's folder.
    stitch : ViewErrorSettings
        What arm and laser err by from view to view, for stitching.
    both : dict
        Keys of both jobs, of their tables [arm], [laser] and [simulation].
    calibration : dict
        Keys of the job that calibrates.
    """

    calibrate: str
    scan: str
    stitch: ViewErrorSettings = ViewErrorSettings()
    both: dict[str, Any] = Field(default_factory=dict)
    calibration: dict[str, Any] = Field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Chain:
    """A chain, ready to run.

    Parameters
    ----------
    calibrate, scan : Path
        The jobs.
    repeatability : ArmRepeatability
        What arm and laser err by from view to view.
    both, calibration : dict
        Dotted keys and their values, of both jobs and of the one that calibrates.
    """

    calibrate: Path
    scan: Path
    repeatability: ArmRepeatability
    both: dict[str, Any]
    calibration: dict[str, Any]

    def with_keys(self, keys: dict[str, Any]) -> Chain:
        """Return the same chain with other values of some keys of both jobs."""
        return replace(self, both=self.both | keys)


def read_chain(file: Path) -> Chain:
    """Read a chain's file.

    Raises
    ------
    ConfigurationError
        If it can't be read, or sets a key for both jobs that is not of the cell.
    """
    read = validate_table(ChainFile, read_toml(file), file)
    both = flatten_to_dotted_keys(read.both)
    for key in both:
        if not key.startswith(SHARED):
            raise ConfigurationError(
                "is not of the cell that both jobs share; there stand [both.arm], [both.laser] "
                "and [both.simulation]",
                file=file,
                key=f"both.{key}",
            )
    folder = file.parent
    return Chain(
        folder / read.calibrate,
        folder / read.scan,
        ArmRepeatability(read.stitch.repeatability, read.stitch.angular_repeatability),
        both,
        flatten_to_dotted_keys(read.calibration),
    )
