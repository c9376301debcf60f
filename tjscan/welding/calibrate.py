"""Fitting the bead model to beads on a plate: width, contact angles, deposition, torch offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from tjscan.core.errors import CalibrationRefused
from tjscan.core.frames import Array, array_dataclass
from tjscan.welding.bead import BeadModel, lay_beads

FEWEST_PLATE_BEADS: Final = 3

PRIOR_SIGMAS: Final = np.array((0.15, np.deg2rad(10), np.deg2rad(10), 0.1, 1e-3))
"""Standard deviations of the values before the fit: width and deposition as shares, both contact
angles, the offset. What the beads don't show stays about where it was."""

SURFACE_SIGMA: Final = 0.1e-3
"""By how much a bead's surface leaves the model's, metres; neighbouring columns do so alike."""

CORRELATED_COLUMNS: Final = 8.0
"""Columns that count as one for the standard deviations."""

LARGEST_MISFIT: Final = 0.5e-3
"""Beads that the fitted model misses by more, rms, metres, are refused."""

BEAD_REACH: Final = 0.8
"""Columns are compared so many widths from the aim; the plate's line follows from those beyond."""


@array_dataclass
class PlateBead:
    """A bead on a plate as it was welded, and its scan; n sections of m columns.

    Parameters
    ----------
    u, w : ndarray, shape (n, m)
        Across the bead, growing, and height, metres.
    aim : ndarray, shape (n,)
        u where the torch's pose had the wire meet the plate, metres.
    nominal_area : ndarray, shape (n,)
        π d²/4 · wire feed / travel speed, m².
    heat_input, weave : ndarray, shape (n,)
        J/m, metres.
    tilt : ndarray, shape (n,)
        Of gravity in the section, radians.
    """

    u: Array
    w: Array
    aim: Array
    nominal_area: Array
    heat_input: Array
    weave: Array
    tilt: Array


@dataclass(frozen=True, slots=True, eq=False)
class FittedBeads:
    """A bead model that fits beads on a plate.

    Parameters
    ----------
    model : BeadModel
    efficiency : float
        Share of the molten wire that ends in the weld.
    offset : float
        Where the wire points beside the torch's pose, along u, metres.
    sigmas : dict of str to float
        Standard deviations, by the name of each value.
    rms : float
        Of the distances of the scan from the model, metres.
    """

    model: BeadModel
    efficiency: float
    offset: float
    sigmas: dict[str, float]
    rms: float


def fit_bead_model(
    beads: Sequence[PlateBead], efficiency: float, model: BeadModel | None = None
) -> FittedBeads:
    """Fit the bead model to beads that lie apart on a plate.

    Parameters
    ----------
    beads : sequence of PlateBead
        Three or more, of different areas.
    efficiency : float
        As the WPS states it, to begin with.
    model : BeadModel, optional
        To begin with.

    Raises
    ------
    CalibrationRefused
        If there are too few beads, one is not there, or the model does not fit them.
    """
    if len(beads) < FEWEST_PLATE_BEADS:
        raise CalibrationRefused(
            "too few beads", f"{len(beads)}, and {FEWEST_PLATE_BEADS} of different areas are needed"
        )
    begin = model or BeadModel()
    names = ("width_factor", "least_contact", "largest_contact", "efficiency", "offset")
    plates = [_plate_below(bead, begin) for bead in beads]
    start = np.array(
        (begin.width_factor, begin.least_contact, begin.largest_contact, efficiency, 0.0)
    )
    scale = PRIOR_SIGMAS * (start[0], 1, 1, efficiency, 1)

    def model_of(values: Array) -> BeadModel:
        return replace(begin, **dict(zip(names[:3], values[:3].tolist(), strict=True)))

    def distances(x: Array) -> list[Array]:
        values = start + scale * x
        now = model_of(values)
        found = []
        for bead, plate in zip(beads, plates, strict=True):
            width = now.bead_width(bead.heat_input, bead.weave)
            laid = lay_beads(
                now,
                bead.u,
                plate,
                centre=bead.aim + values[4],
                width=width,
                area=values[3] * bead.nominal_area,
                tilt=bead.tilt,
            )
            near = np.abs(bead.u - bead.aim[:, None]) < BEAD_REACH * width[:, None]
            found.append(np.where(near, laid.w - bead.w, 0.0).ravel())
        return found

    weight = 1 / (SURFACE_SIGMA * np.sqrt(CORRELATED_COLUMNS))

    def residuals(x: Array) -> Array:
        return np.concatenate((*(weight * row for row in distances(x)), x))

    fit = least_squares(residuals, np.zeros(5), x_scale=1.0, diff_step=[1e-2])
    values = start + scale * fit.x
    jacobian = np.asarray(fit.jac)
    sigmas = scale * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    off = np.concatenate(distances(fit.x))
    rms = float(np.sqrt(np.mean(off[off != 0] ** 2)))
    if rms > LARGEST_MISFIT:
        raise CalibrationRefused(
            "the model does not fit",
            f"the scan leaves the fitted beads by {1e3 * rms:.2f} mm rms, more than "
            f"{1e3 * LARGEST_MISFIT:g} mm: are feed, speed and place of each bead as stated?",
        )
    return FittedBeads(
        model_of(values),
        float(values[3]),
        float(values[4]),
        dict(zip(names, sigmas.tolist(), strict=True)),
        rms,
    )


def _plate_below(bead: PlateBead, model: BeadModel) -> Array:
    """Height of the plate below a bead, from the columns beside it, shape (n, m), metres."""
    width = model.bead_width(bead.heat_input, bead.weave)
    x = bead.u - bead.aim[:, None]
    beside = (np.abs(x) > BEAD_REACH * width[:, None]).astype(float)
    if (beside.sum(axis=1) < 6).any():
        raise CalibrationRefused(
            "no plate beside a bead", "its sections must reach farther than the bead is wide"
        )
    count, mean = beside.sum(axis=1), (beside * x).sum(axis=1)
    height = (beside * bead.w).sum(axis=1)
    square, both = (beside * x**2).sum(axis=1), (beside * x * bead.w).sum(axis=1)
    slope = (count * both - mean * height) / (count * square - mean**2)
    plate = ((height - slope * mean) / count)[:, None] + slope[:, None] * x
    if (np.abs(bead.w - plate).max(axis=1) < LARGEST_MISFIT).all():
        raise CalibrationRefused(
            "a bead is not there", "a scan shows a bare plate where it was welded"
        )
    return np.asarray(plate)
