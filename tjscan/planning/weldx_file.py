"""``plan.weldx``: the beads as moving frames of a weldx file, with their speed and heat input."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from tjscan.core.units import M_PER_MIN, MM
from tjscan.planning.document import PlanDocument
from tjscan.planning.lay import PlannedBead
from tjscan.planning.plan import WeldPlan
from tjscan.planning.wps import KJ_PER_MM, MM_PER_MIN, WeldingProcedure


def weldx_is_installed() -> bool:
    """Whether weldx files can be written."""
    return find_spec("weldx") is not None


def write_plan_as_weldx(file: Path, plan: WeldPlan, document: PlanDocument, root: str) -> None:
    """Write a plan as a weldx file.

    Every bead is a frame ``torch, bead N`` below the root that moves with time from the bead's
    start, z along the wire; further parts of it are ``torch, bead N, part 2`` and so on. They are
    under ``coordinate_systems``; wire feed, travel speed, heat input and power of each under
    ``beads``; the document of ``plan.json`` under ``plan``.

    Parameters
    ----------
    file : Path
        The file to write; weldx is installed.
    plan : WeldPlan
        The plan.
    document : PlanDocument
        As in ``plan.json``.
    root : str
        What the frame of the sections is called in the tree of frames.
    """
    weldx: Any = import_module("weldx")
    frames = weldx.CoordinateSystemManager(root, "weld plan")
    beads = []
    for bead in plan.beads:
        part = f", part {bead.part}" if bead.part > 1 else ""
        times = weldx.Time(weldx.Q_(bead.times, "s"))
        places = weldx.Q_(bead.points / MM.factor, "mm")
        frame = weldx.LocalCoordinateSystem(bead.T_r_torch[:, :3, :3], places, times)
        frames.add_cs(f"torch, bead {bead.number}{part}", root, frame)
        beads.append(_bead_settings(weldx, bead, times, plan.wps))
    tree = {"plan": document.model_dump(mode="json"), "coordinate_systems": frames, "beads": beads}
    with weldx.WeldxFile(tree=tree, mode="rw") as made:
        made.write_to(file)


def _bead_settings(
    weldx: Any, bead: PlannedBead, times: Any, wps: WeldingProcedure
) -> dict[str, Any]:
    def over_time(values: Any, unit: str) -> Any:
        return weldx.TimeSeries(weldx.Q_(np.asarray(values), unit), times, "linear")

    return {
        "bead": bead.number,
        "part": bead.part,
        "kind": bead.kind,
        "wire_feed": over_time(bead.feed / M_PER_MIN.factor, "m/min"),
        "power": over_time(wps.arc.power_at(bead.feed), "W"),
        "travel_speed": over_time(bead.speed / MM_PER_MIN.factor, "mm/min"),
        "heat_input": over_time(bead.heat / KJ_PER_MM.factor, "kJ/mm"),
    }
