"""The job of a weld: a scan's job, with what is welded and the power source."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Ge, Le, MaxLen, MinLen

from tjscan.core.devices import DriverKind
from tjscan.core.units import LIST_OR_WORD_IN_FILE, MM, SettingsTable
from tjscan.job.devices import PowerSettings
from tjscan.job.files import ScanJob, read_located_job
from tjscan.power.height import ArcHeightSettings
from tjscan.power.sequence import ArcLimits
from tjscan.welding.bead import BeadModel
from tjscan.welding.world import WeldFaults


@dataclass(frozen=True, slots=True, kw_only=True)
class WeldSimulationSettings(WeldFaults):
    """The table [weld.simulation]: what goes otherwise than set in a simulated weld.

    Parameters
    ----------
    seed : int
        Of all that wanders.
    height : float
        By which the torch is too high at the end of the groove, metres; at its start it is not.
    """

    seed: Annotated[int, Ge(0)] = 1
    height: Annotated[float, Ge(-5), Le(5), MM] = 0.0


Direction = Annotated[tuple[float, float, float], LIST_OR_WORD_IN_FILE]


@dataclass(frozen=True, slots=True, kw_only=True)
class WeldSettings(SettingsTable):
    """The table [weld]: by which procedure, and how it is looked at.

    Parameters
    ----------
    wps : str
        File of the welding procedure specification, counted from the job's folder.
    gravity : tuple of float
        Direction downwards in the frame of the scan's results.
    station_step : float
        Between two sections at which the weld is planned, metres.
    look_step : float
        Between two profiles of a look, metres.
    margin : float
        Of the faces beyond the toes that a look reads, metres.
    overlap : float
        By which a weld that goes on after a stop overlaps what was welded before, metres; not
        less than what a second ignition is farther on.
    holds : tuple of int
        Beads before which a person must let the weld go on.
    arc : ArcLimits
    height : ArcHeightSettings, optional
        How the torch's height follows the current; without, it stays as planned.
    bead : BeadModel
        By which beads are planned; a simulated weld has its own, with the defaults.
    simulation : WeldSimulationSettings
    """

    wps: Annotated[str, MinLen(1)]
    gravity: Direction = (0.0, 0.0, -1.0)
    station_step: Annotated[float, Ge(0.5), Le(20), MM] = 2e-3
    look_step: Annotated[float, Ge(0.5), Le(20), MM] = 4e-3
    margin: Annotated[float, Ge(2), Le(50), MM] = 8e-3
    overlap: Annotated[float, Ge(2), Le(100), MM] = 10e-3
    holds: Annotated[tuple[int, ...], MaxLen(200), LIST_OR_WORD_IN_FILE] = ()
    arc: ArcLimits = field(default_factory=ArcLimits)
    height: ArcHeightSettings | None = None
    bead: BeadModel = field(default_factory=BeadModel)
    simulation: WeldSimulationSettings = field(default_factory=WeldSimulationSettings)

    def __post_init__(self) -> None:
        if not sum(x * x for x in self.gravity):
            raise ValueError("gravity is a direction: not all of its numbers can be zero")


class WeldJob(ScanJob):
    """A job file that describes a weld."""

    weld: WeldSettings
    power: PowerSettings = PowerSettings()

    def contradictions(self) -> Iterator[tuple[str, str]]:
        """Yield also what can't be welded."""
        yield from super().contradictions()
        if self.arm.driver_kind is not DriverKind.SIMULATED:
            yield (
                "arm.driver",
                "a weld leads the torch of a simulated arm alone: for a real one scan, and write "
                "its program with 'tjscan plan'",
            )
        if not self.power.is_on_this_machine:
            yield (
                "power.driver",
                "a weld leads the torch of a simulated arm alone, and a real arc would burn in one "
                "spot: take the simulated power source, or a modbus one on this machine (such as "
                "'tjscan power-loopback')",
            )
        if self.joint is None:
            yield "joint", "a simulated weld needs a [joint] table to weld on"

    @property
    def scan_job(self) -> ScanJob:
        """The job of its scan."""
        return ScanJob.model_construct(
            **{name: getattr(self, name) for name in ScanJob.model_fields}
        )


def read_weld_job(file: Path, overrides: dict[str, Any] | None = None) -> WeldJob:
    """Read the job of a weld, with single keys replaced; see `read_job`."""
    return read_located_job(WeldJob, file, overrides)
