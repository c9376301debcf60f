"""Three beads on a plate give back the model that laid them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tjscan.core.errors import CalibrationRefused
from tjscan.welding.bead import BeadModel, lay_beads
from tjscan.welding.calibrate import FittedBeads, PlateBead, fit_bead_model

TRUE = replace(BeadModel(), width_factor=8.8e-3, largest_contact=np.deg2rad(62))


def plate_beads(efficiency: float, offset: float, noise: float) -> list[PlateBead]:
    """Three beads, the last one so narrow that its contact angle is the largest."""
    rng, n = np.random.default_rng(5), 12
    u = np.tile(np.arange(-18e-3, 18e-3, 0.3e-3), (n, 1))
    plate = 0.4e-3 + 0.02 * u
    found = []
    for nominal, heat in ((20e-6, 0.8e6), (30e-6, 1.3e6), (60e-6, 0.7e6)):
        row = np.ones(n)
        w = lay_beads(
            TRUE, u, plate, centre=offset * row, width=TRUE.bead_width(heat * row),
            area=efficiency * nominal * row, tilt=0 * row,
        ).w  # fmt: skip
        w = w + noise * rng.standard_normal(w.shape)
        found.append(PlateBead(u, w, 0 * row, nominal * row, heat * row, 0 * row, 0 * row))
    return found


def fitted() -> FittedBeads:
    return fit_bead_model(plate_beads(0.91, 0.4e-3, 0.03e-3), 0.95)


def test_model_efficiency_and_offset_come_back_within_their_sigmas() -> None:
    fit = fitted()
    for name, value, true in (
        ("width_factor", fit.model.width_factor, TRUE.width_factor),
        ("largest_contact", fit.model.largest_contact, TRUE.largest_contact),
        ("efficiency", fit.efficiency, 0.91),
        ("offset", fit.offset, 0.4e-3),
    ):
        assert abs(value - true) < 3 * fit.sigmas[name], name
    assert fit.efficiency == pytest.approx(0.91, rel=0.02)
    assert fit.model.width_factor == pytest.approx(8.8e-3, rel=0.04)
    assert fit.offset == pytest.approx(0.4e-3, abs=0.1e-3)
    assert fit.rms < 0.1e-3


def test_what_no_bead_shows_stays_and_says_so() -> None:
    # No bead is so flat that its contact angle would be the least one.
    assert fitted().sigmas["least_contact"] > np.deg2rad(8)


def test_beads_that_are_missing_few_or_wrong_are_refused() -> None:
    beads = plate_beads(0.95, 0.0, 0.02e-3)
    with pytest.raises(CalibrationRefused, match="too few beads"):
        fit_bead_model(beads[:2], 0.95)
    bare = replace(beads[1], w=0.4e-3 + 0.02 * beads[1].u)
    with pytest.raises(CalibrationRefused, match="a bead is not there"):
        fit_bead_model([beads[0], bare, beads[2]], 0.95)
    thrice = [replace(bead, nominal_area=3 * bead.nominal_area) for bead in beads]
    swapped = [thrice[0], beads[1], replace(beads[2], nominal_area=0.3 * beads[2].nominal_area)]
    with pytest.raises(CalibrationRefused, match="does not fit"):
        fit_bead_model(swapped, 0.95)
