"""The fit of a bead model to beads on a plate, from a file and the table of a scan."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from tjscan.core.config import StrictFileModel, add_file_to_errors, read_toml, validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.units import LIST_OR_WORD_IN_FILE, M_PER_MIN, MM, SettingsTable
from tjscan.planning.wps import KJ_PER_MM, MM_PER_MIN, WireSettings
from tjscan.welding.calibrate import FittedBeads, PlateBead, fit_bead_model

PLATE_COLUMNS: Final = ("section", "u_mm", "w_mm")
"""Head of the table of a plate's scan."""

PLATE_COLUMN_STEP, PLATE_REACH = 0.3e-3, 18e-3
"""Between columns of a bead, and how far they reach to both sides of its aim, metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateBeadSettings(SettingsTable):
    """A bead on a plate, a table ``[[bead]]``.

    Parameters
    ----------
    aim : float
        u where the wire was to meet the plate, metres.
    wire_feed, travel_speed : float
        m/s.
    heat_input : float
        J/m.
    weave : float
        Width of the weave, metres.
    """

    aim: Annotated[float, Ge(-2000), Le(2000), MM]
    wire_feed: Annotated[float, Gt(0), Le(50), M_PER_MIN]
    travel_speed: Annotated[float, Gt(0), Le(5000), MM_PER_MIN]
    heat_input: Annotated[float, Gt(0), Le(20), KJ_PER_MM]
    weave: Annotated[float, Ge(0), Le(50), MM] = 0.0


class PlateFile(StrictFileModel):
    """A file of beads on a plate, and the table of its scan beside it."""

    scan: Annotated[str, MinLen(1)]
    wire: WireSettings
    bead: Annotated[tuple[PlateBeadSettings, ...], MinLen(1), LIST_OR_WORD_IN_FILE]


def fit_plate(file: Path) -> FittedBeads:
    """Fit the bead model to the beads of a plate, as a file states them; see `fit_bead_model`.

    Beads lie twice `PLATE_REACH` apart, or farther.
    """
    plate = validate_table(PlateFile, read_toml(file), file)
    sections = _read_plate_scan(file.parent / plate.scan)
    wire = 0.25 * np.pi * plate.wire.diameter**2
    beads = []
    for one in plate.bead:
        u = one.aim + np.arange(-PLATE_REACH, PLATE_REACH, PLATE_COLUMN_STEP)
        w = np.array([np.interp(u, *rows.T) for rows in sections])
        n = len(w)
        beads.append(
            PlateBead(
                np.tile(u, (n, 1)),
                w,
                np.full(n, one.aim),
                np.full(n, wire * one.wire_feed / one.travel_speed),
                np.full(n, one.heat_input),
                np.full(n, one.weave),
                np.zeros(n),
            )
        )
    return fit_bead_model(beads, plate.wire.deposition_efficiency)


def _read_plate_scan(file: Path) -> list[Array]:
    """Sections of a plate's scan, each (k, 2) with u growing, metres."""
    with add_file_to_errors(file):
        try:
            lines = file.read_text(encoding="utf-8").splitlines()
            head, rows = lines[0].split(","), np.loadtxt(lines[1:], delimiter=",", ndmin=2)
        except (OSError, UnicodeDecodeError, ValueError, IndexError) as error:
            raise ConfigurationError(f"is no table of numbers: {error}") from None
        if tuple(head) != PLATE_COLUMNS or not np.isfinite(rows).all() or len(rows) < 2:
            raise ConfigurationError(f"needs the columns {','.join(PLATE_COLUMNS)}, all filled")
        groups = [rows[rows[:, 0] == section, 1:] for section in np.unique(rows[:, 0])]
        return [1e-3 * group[np.argsort(group[:, 0])] for group in groups]


def bead_model_as_toml(fit: FittedBeads) -> str:
    """A fitted bead model as the table [weld.bead] of a job, with standard deviations."""
    model, sigmas = fit.model, fit.sigmas
    angle = np.rad2deg
    return "\n".join(
        (
            "[weld.bead]",
            f"width_factor_mm = {1e3 * model.width_factor:.3f}  # ± "
            f"{1e3 * sigmas['width_factor']:.3f}",
            f"least_contact_deg = {angle(model.least_contact):.1f}  # ± "
            f"{angle(sigmas['least_contact']):.1f}",
            f"largest_contact_deg = {angle(model.largest_contact):.1f}  # ± "
            f"{angle(sigmas['largest_contact']):.1f}",
            f"# of the WPS: deposition_efficiency = {fit.efficiency:.4f}  # ± "
            f"{sigmas['efficiency']:.4f}",
            f"# the wire points {1e3 * fit.offset:.2f} ± {1e3 * sigmas['offset']:.2f} mm beside "
            "its pose",
        )
    )
