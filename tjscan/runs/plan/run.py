"""Plan the weld of a measured groove and write the plan into its run directory."""

from __future__ import annotations

from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path

import numpy as np

from tjscan.core.errors import ConfigurationError
from tjscan.core.files import write_files_atomically
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.core.units import MM2
from tjscan.planning.document import PlanDocument, plan_document
from tjscan.planning.edges import fit_groove_edges
from tjscan.planning.plan import WeldPlan, plan_weld
from tjscan.planning.stops import NOBODY, crowns_and_saddles
from tjscan.planning.urscript import StationWay, way_to_urscript
from tjscan.planning.wps import read_wps
from tjscan.result.directory import SECTIONS, job_label_of_run
from tjscan.result.export import sort_sections_by_azimuth
from tjscan.result.shapes import read_finished_summary
from tjscan.result.summary import ScanSummary
from tjscan.result.table import read_sections_csv
from tjscan.runs.plan.details import details_of_run
from tjscan.runs.plan.files import EARLIER, PLAN, add_file_of_key, write_plan_files
from tjscan.runs.plan.programs import PartedPlan, part_plan
from tjscan.runs.plan.welding_station import WeldingStation, welding_stations


@dataclass(frozen=True, slots=True)
class ArcSwitch:
    """How a program switches the arc.

    Parameters
    ----------
    output : int
        Number of the controller's standard digital output.
    on : bool
        Whether it is switched on on the beads; else it stays off throughout.
    """

    output: int
    on: bool


@dataclass(frozen=True, slots=True, eq=False)
class WrittenPlan:
    """A plan that was written.

    Parameters
    ----------
    plan : WeldPlan
        The plan.
    document : PlanDocument
        As it stands in ``plan.json``.
    directory : Path
        Where its files are.
    files : tuple of str
        Their names.
    ways : dict of str to StationWay
        How each station leads the torch, by its program's file.
    """

    plan: WeldPlan
    document: PlanDocument
    directory: Path
    files: tuple[str, ...]
    ways: dict[str, StationWay] = field(default_factory=dict)

    @property
    def nobody_s(self) -> tuple[tuple[float, float], ...]:
        """Lengths that no station reaches, where that was looked for; metres."""
        found = [bead for bead in self.plan.beads if bead.station == NOBODY and bead.layer == 1]
        spans = tuple((float(bead.s.min()), float(bead.s.max())) for bead in found)
        return spans if self.document.stations else ()


def plan_run(
    directory: Path,
    wps_file: Path,
    gravity: Array,
    switch: ArcSwitch,
    out: Path | None = None,
    after_pass: int = 0,
    *,
    reach: bool = True,
) -> WrittenPlan:
    """Plan the weld of a run's groove and write the plan's files.

    Parameters
    ----------
    directory : Path
        The run directory, of one scan or stitched.
    wps_file : Path
        The welding procedure specification.
    gravity : ndarray, shape (3,)
        Downwards in the frame of the run's sections.
    switch : ArcSwitch
        How the arc is switched in the program.
    out : Path, optional
        Where the files go; the run directory where left out.
    after_pass : int
        Passes that were welded before the groove was measured.
    reach : bool
        Whether to find out what the arm reaches; without that there is no program.

    Raises
    ------
    ConfigurationError
        If the WPS or the run can't be read, or nothing that the WPS allows fits.
    RecordingError
        If the files can't be written.
    """
    wps = read_wps(wps_file)
    summary = read_finished_summary(directory)
    sections = sort_sections_by_azimuth(read_sections_csv(directory / SECTIONS))
    with add_file_of_key(wps_file, directory / SECTIONS):
        shared = _shared_area_sigma(summary)
        edges = fit_groove_edges(sections, wps.sequence.longest_step, shared)
        # In frame j, z is the brace's axis; in an arm's base frame nothing is known of the tubes.
        marks = crowns_and_saddles(edges, np.eye(4)) if summary.frame == "j" else np.empty(0)
        plan = plan_weld(edges, wps, gravity, marks, after_pass=after_pass)
        details = details_of_run(directory, sections, edges, wps)
        arms, without = (
            _arms(directory, summary.frame) if reach else ((), "reach was not asked for")
        )
        parted = PartedPlan(plan, (), {})
        if arms:
            parted = part_plan(
                arms, plan, sections, lambda s: plan_weld(edges, wps, gravity, marks, s, after_pass)
            )
            plan = parted.plan
    provenance = Provenance.for_file_written_now(job_label_of_run(directory), summary.frame, "mm")
    label = f"{wps.name}, SHA-256 {sha256(wps_file.read_bytes()).hexdigest()[:16]}"
    document = plan_document(
        plan, provenance, directory.resolve().name, label, details, parted.stations, without
    )
    folder = out or directory
    with write_files_atomically(folder, last=PLAN, instead_of=EARLIER) as draft:
        lines = provenance.comment_lines("#").splitlines(keepends=True)[:3]  # no frame, no units
        for name, way in parted.ways.items():
            script = way_to_urscript(way, wps.torch, switch.output, arc=switch.on)
            (draft / name).write_text("".join((*lines, script)), encoding="utf-8")
        write_plan_files(draft, plan, document, provenance)
        files = tuple(sorted(file.name for file in draft.iterdir()))
    return WrittenPlan(plan, document, folder, files, parted.ways)


def _shared_area_sigma(summary: ScanSummary) -> float:
    """Standard deviation by which the areas of all sections err alike, m²; 0 where not known."""
    parts = () if summary.uncertainty is None else summary.uncertainty.components
    return MM2.factor * float(np.linalg.norm([part.area_mm2 for part in parts if part.shared]))


def _arms(directory: Path, frame: str) -> tuple[tuple[WeldingStation, ...], str]:
    """Arms of a run, or why they are not known."""
    try:
        return welding_stations(directory, frame), ""
    except ConfigurationError as error:
        return (), str(error)
