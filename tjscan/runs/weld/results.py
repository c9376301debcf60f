"""The log of a weld: every number in it states where it comes from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from statistics import median
from typing import Any, Final

from tjscan.core.files import write_files_atomically
from tjscan.core.provenance import Provenance
from tjscan.core.sourced import ABSENT_NUMBER, NumberSource, number_entry, value_entry
from tjscan.core.units import (
    LITRE_PER_MINUTE,
    M_PER_MIN,
    MM,
    MM2,
    NO_UNIT,
    SECONDS,
    FileUnit,
)
from tjscan.planning.wps import KJ_PER_MM, MM_PER_MIN
from tjscan.recording.journal import RunEvent
from tjscan.recording.parts import recording_files
from tjscan.result.directory import JOB_FILE, job_label_of_run
from tjscan.runs.weld.journal import (
    HEIGHT_EVENT,
    WELD_RECORDING,
    ArcMessage,
    ArcStretchMessage,
    LookMessage,
    PlannedBeadMessage,
    read_weld,
)

WELD_LOG_FILE: Final = "weld-log.json"

SIMULATED_WELD_NOTE: Final = "SIMULATED: no metal was melted, and no real arm led the torch"
"""What every file and page of a simulated weld says."""

AMPERE_UNIT: Final = FileUnit("A")
VOLT_UNIT: Final = FileUnit("V")
CELSIUS_UNIT: Final = FileUnit("C")

STRETCH_UNITS: Final[Mapping[str, FileUnit]] = {
    "current": AMPERE_UNIT,
    "current_least": AMPERE_UNIT,
    "current_most": AMPERE_UNIT,
    "voltage": VOLT_UNIT,
    "feed": M_PER_MIN,
    "gas": LITRE_PER_MINUTE,
    "speed": MM_PER_MIN,
    "heat_input": KJ_PER_MM,
    "raised": MM,
}
"""Numbers of a stretch and the units that the log gives them in."""

HASHED_INPUTS: Final = (JOB_FILE, "wps.toml", "scan/sections.csv")
"""Files that a weld rests on, whose SHA-256 the log states, beside its recordings."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedWeld:
    """What the recording of a weld holds, by kind.

    Parameters
    ----------
    beads : tuple of PlannedBeadMessage
        As planned last, one a bead and station, in the order welded; by a dry run where nothing
        else planned them.
    arcs, stretches, looks, events : tuple
        In their order.
    """

    beads: tuple[PlannedBeadMessage, ...]
    arcs: tuple[ArcMessage, ...]
    stretches: tuple[ArcStretchMessage, ...]
    looks: tuple[LookMessage, ...]
    events: tuple[RunEvent, ...]

    @property
    def source(self) -> NumberSource:
        """Of what its devices report."""
        simulated = all(arc.simulated for arc in self.arcs)
        return NumberSource.SIMULATED if simulated else NumberSource.MEASURED

    def arcs_of(self, bead: PlannedBeadMessage) -> list[ArcMessage]:
        """Those of one bead."""
        return [arc for arc in self.arcs if bead.is_of(arc)]


def read_recorded_weld(directory: Path) -> RecordedWeld:
    """Read a weld's recording; raises as `read_weld` does."""
    kinds: dict[type, list[Any]] = {}
    for message in read_weld(directory):
        kinds.setdefault(type(message), []).append(message)
    planned = sorted(kinds.get(PlannedBeadMessage, []), key=lambda one: not one.dry)
    beads = tuple({(bead.number, bead.station): bead for bead in planned}.values())
    others = (ArcMessage, ArcStretchMessage, LookMessage, RunEvent)
    return RecordedWeld(beads, *(tuple(kinds.get(kind, ())) for kind in others))


def write_weld_results(directory: Path) -> None:
    """Write the log of a weld from its recording, however far it came."""
    if not (directory / f"{WELD_RECORDING}.mcap").is_file():
        return
    found = read_recorded_weld(directory)
    text = json.dumps(weld_log(directory, found), indent=1, ensure_ascii=False)
    with write_files_atomically(directory, last=WELD_LOG_FILE) as draft:
        (draft / WELD_LOG_FILE).write_text(text + "\n", encoding="utf-8")


def weld_log(directory: Path, found: RecordedWeld) -> dict[str, Any]:
    """The log as JSON holds it: each number is an object of value, unit and source.

    Parameters
    ----------
    directory : Path
        Of the run.
    found : RecordedWeld
        Its recording.
    """
    inputs = [directory / name for name in HASHED_INPUTS]
    inputs += recording_files(directory, WELD_RECORDING)
    provenance = Provenance.for_file_written_now(job_label_of_run(directory), "j")
    return {
        "schema": "tjscan.weld-log",
        "note": SIMULATED_WELD_NOTE if found.source is NumberSource.SIMULATED else "",
        "job": provenance.job,
        "program": provenance.program,
        "written": str(provenance.written),
        "sha256": {
            str(file.relative_to(directory)): sha256(file.read_bytes()).hexdigest()
            for file in inputs
            if file.is_file()
        },
        "preheat_temperature": number_entry(ABSENT_NUMBER, CELSIUS_UNIT),
        "interpass_temperature": number_entry(ABSENT_NUMBER, CELSIUS_UNIT),
        "beads": [_bead_entry(found, bead) for bead in found.beads],
        "looks": [_look_entry(look, found.source) for look in found.looks],
        "stops": [event.detail for event in found.events if event.name == "stop"],
        "height_at_bound": [event.detail for event in found.events if event.name == HEIGHT_EVENT],
    }


def _bead_entry(found: RecordedWeld, bead: PlannedBeadMessage) -> dict[str, Any]:
    planned, set_ = NumberSource.BELIEVED, NumberSource.SET
    return {
        "bead": str(bead.number + 1),
        "layer": str(bead.layer + 1),
        "station": bead.station,
        "planned": {
            "area_least": value_entry(bead.area.min(), planned, MM2),
            "area_most": value_entry(bead.area.max(), planned, MM2),
            "speed_least": value_entry(bead.speed.min(), set_, MM_PER_MIN),
            "speed_most": value_entry(bead.speed.max(), set_, MM_PER_MIN),
            "at_a_limit_of_the_wps": value_entry(bead.is_at_limit.mean(), planned, NO_UNIT),
        },
        "arcs": [_arc_entry(arc) for arc in found.arcs_of(bead)],
        "stretches": [_stretch_entry(row) for row in found.stretches if bead.is_of(row)],
    }


def _arc_entry(arc: ArcMessage) -> dict[str, Any]:
    source = NumberSource.SIMULATED if arc.simulated else NumberSource.MEASURED
    return {
        "begin": value_entry(arc.begin, source, MM),
        "end": value_entry(arc.end, source, MM),
        "arc_time": value_entry(arc.seconds, source, SECONDS),
        "fault": arc.fault,
    }


def _stretch_entry(row: ArcStretchMessage) -> dict[str, Any]:
    moved = row.speed.source
    return {
        "begin": value_entry(row.begin, moved, MM),
        "end": value_entry(row.end, moved, MM),
        **{name: number_entry(getattr(row, name), unit) for name, unit in STRETCH_UNITS.items()},
    }


def _look_entry(look: LookMessage, measured: NumberSource) -> dict[str, Any]:
    believed = NumberSource.BELIEVED
    return {
        "after_passes": str(look.beads),
        "station": look.station,
        "read": value_entry(look.read.mean(), measured, NO_UNIT),
        "height_sigma": value_entry(median(look.sigma), believed, MM),
        "torch_deviation": value_entry(look.deviation, measured, MM),
        "torch_deviation_sigma": value_entry(look.deviation_sigma, believed, MM),
        "deposition_gain": value_entry(look.gain, believed, NO_UNIT),
        "torch_offset": value_entry(look.offset, believed, MM),
        "shrinkage_factor": value_entry(look.shrinkage, believed, NO_UNIT),
    }
