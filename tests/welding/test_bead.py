"""Beads: area, surface tension and gravity, mirror images, contact angles, pools that fall."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.welding.aims import FIRST_STEPS, AimSearch
from tjscan.welding.bead import BeadModel, LaidBeads, column_widths, lay_beads
from tjscan.welding.state import WeldState

FREE = replace(BeadModel(), least_contact=-3.0, largest_contact=3.0)
U = np.arange(-20e-3, 20e-3, 0.1e-3)


def lay(
    model: BeadModel, w: Array, centre: float, width: float, area: float, tilt: float
) -> LaidBeads:
    one = np.ones(1)
    return lay_beads(
        model, U[None], w[None], centre=centre * one, width=width * one, area=area * one,
        tilt=tilt * one,
    )  # fmt: skip


def full_young_laplace(tilt: float, chord: float, width: float, area: float) -> Array:
    """Surface over U between toes at ±width/2 of a straight solid, without linearising."""

    def rates(x: Array, y: Array, p: Array) -> Array:
        bend = (y[0] * np.cos(tilt) + x * np.sin(tilt)) / BeadModel().capillary_length ** 2 - p[0]
        return np.array([y[1], bend * (1 + y[1] ** 2) ** 1.5, y[0] - chord * x])

    def ends(a: Array, b: Array, p: Array) -> Array:
        half = chord * width / 2
        return np.array([a[0] + half, b[0] - half, a[2], b[2] - area])

    x = np.linspace(-width / 2, width / 2, 200)
    y = chord * x + 1.5 * area / width * (1 - (2 * x / width) ** 2)
    guess = np.array([y, np.gradient(y, x), np.cumsum(y - chord * x) * (x[1] - x[0])])
    found = solve_bvp(rates, ends, x, guess, p=[12 * area / width**3], tol=1e-8, max_nodes=20000)
    assert found.success
    inside = np.abs(U) < width / 2
    assert np.abs(np.arctan(found.sol(U[inside])[1])).max() < radians(45)
    return np.where(inside, found.sol(U)[0], chord * U)


@pytest.mark.parametrize(
    ("tilt", "chord", "width", "area"),
    [(0.0, 0.0, 10e-3, 8e-6), (0.0, 0.0, 10e-3, 12e-6), (0.5, -0.3, 10e-3, 10e-6),
     (1.2, -0.3, 10e-3, 10e-6), (1.57, -0.3, 9e-3, 8e-6), (2.2, -0.3, 8e-3, 8e-6)],
)  # fmt: skip
def test_surface_is_that_of_young_and_laplace(
    tilt: float, chord: float, width: float, area: float
) -> None:
    laid = lay(FREE, chord * U, 0.0, width * np.hypot(1, chord), area, tilt)
    truth = full_young_laplace(tilt, chord, width, area)
    height = np.abs(truth - chord * U).max()
    np.testing.assert_allclose(laid.w[0], truth, atol=0.055 * height)
    if tilt == 0:
        np.testing.assert_allclose(laid.w[0], truth, atol=0.03 * height)


@pytest.mark.parametrize("tilt", [0.0, 0.7, 1.6])
def test_area_is_exact_and_mirror_images_agree(tilt: float) -> None:
    rng = np.random.default_rng(4)
    w = np.maximum(np.abs(U) - 2e-3, 0) * 1.6 + 0.3e-3 * np.sin(U * 900 + rng.uniform())
    laid = lay(BeadModel(), w, 2e-3, 10e-3, 30e-6, tilt)
    added = np.sum(column_widths(U) * (laid.w[0] - w))
    assert added == pytest.approx(30e-6, rel=1e-12)
    one = np.ones(1)
    mirrored = lay_beads(
        BeadModel(), -U[None, ::-1], w[None, ::-1], centre=-2e-3 * one, width=10e-3 * one,
        area=30e-6 * one, tilt=-tilt * one,
    )  # fmt: skip
    np.testing.assert_allclose(mirrored.w[0, ::-1], laid.w[0], atol=1e-9)


def test_contact_angles_stay_in_their_window() -> None:
    # Beside a wall, a bead of this width would climb it.
    w = np.where(U < -3e-3, (-3e-3 - U) * 4, 0.0)
    model = BeadModel()
    laid = lay(model, w, -1e-3, 9e-3, 30e-6, 0.0)
    slack = radians(4)
    assert (laid.contact > model.least_contact - slack).all()
    assert (laid.contact < model.largest_contact + slack).all()
    flat = lay(model, 0 * U, 0.0, 5e-3, 30e-6, 0.0)
    assert flat.right[0] - flat.left[0] > 6e-3  # too round to stay as narrow
    assert flat.contact[0] == pytest.approx(np.full(2, model.largest_contact), abs=slack)


@pytest.mark.parametrize("tilt", [-1.1, 0.5, 1.57])
def test_widest_pool_on_a_slope_just_takes_both_contact_angles(tilt: float) -> None:
    model = BeadModel()
    width = float(model.widest_on_slope(np.array(tilt)))
    laid = lay(FREE, 0 * U, 0.0, width, 10e-6, tilt)
    allowed = model.largest_contact - model.least_contact
    assert abs(np.diff(np.tan(laid.contact[0]))[0]) == pytest.approx(allowed, rel=0.12)
    assert np.sign(np.diff(laid.contact[0])[0]) == -np.sign(tilt)  # it runs to the lower side


def test_pool_that_would_fall_is_refused() -> None:
    assert lay(FREE, 0 * U, 0.0, 8e-3, 10e-6, np.pi).w.max() > 0
    with pytest.raises(ConfigurationError, match="fall out of the overhead groove"):
        lay(FREE, 0 * U, 0.0, 13e-3, 10e-6, np.pi).held()


def test_the_search_of_aims_leaves_those_alone_that_would_let_a_pool_fall() -> None:
    """It refuses nothing by itself: only a bead that is laid is held against the bound."""
    width, s = 13e-3, np.zeros(1)
    state = WeldState.of_groove(s, U, 0 * U[None], np.array([[-10e-3, 10e-3]]), s + np.pi)
    search = AimSearch(FREE, state, 1e-3 + state.w, None, s + 10e-6, s[None] + width)
    begin = np.array([[1e-3]])
    aims, shares = search.descend(begin, FIRST_STEPS)
    np.testing.assert_array_equal(aims, begin)
    np.testing.assert_array_equal(shares, [[1.0]])


def test_pool_on_a_steep_face_hangs_as_gravity_square_to_the_face_has_it() -> None:
    """A section turned by the slope is the same pool: held upright, and falling where it hangs."""
    slope, width = radians(60), 13e-3
    rise = np.tan(slope) * U
    with pytest.raises(ConfigurationError, match="fall out"):
        lay(FREE, rise, 0.0, width, 10e-6, np.pi - slope).held()
    # Square to the face no gravity pulls out of it: upright, and beside a bevel that hangs over.
    for tilt in (-slope, radians(-104)):
        laid = lay(FREE, rise, 0.0, width, 10e-6, tilt).held()
        assert np.sum(column_widths(U) * (laid.w[0] - rise)) == pytest.approx(10e-6)


def test_ignition_adds_and_crater_lacks() -> None:
    along = np.linspace(0, 0.2, 201)
    share = BeadModel().area_along_bead(along, 0.2 - along)
    assert share[0] == pytest.approx(1.25)
    assert share[100] == pytest.approx(1.0, abs=1e-3)
    assert share[-1] == pytest.approx(0.65)


def test_toes_of_a_pool_move_together_and_equal_sections_stay_as_they_are() -> None:
    """Gravity pulls across: from a certain place of the wire on a pool runs up the other side."""
    s: Array = 2e-3 * np.arange(41.0)
    one, u = np.ones(len(s)), np.arange(-12e-3, 22e-3, 0.25e-3)
    rows = np.tile(u, (len(s), 1))
    w = np.maximum(np.maximum(-3.1 * (rows + 3e-3), 0.0), 1.58 * (rows - 8e-3))

    def lay_along(centre: Array, along: Array | None) -> LaidBeads:
        width, area, tilt = 13e-3 * one, 40e-6 * one, np.radians(-58.0) * one
        return lay_beads(
            BeadModel(), rows, w, centre=centre, width=width, area=area, tilt=tilt, s=along
        )

    level = 1.1e-3 * one
    np.testing.assert_allclose(lay_along(level, s).w, lay_along(level, None).w, atol=1e-12)
    aside = level + 0.2e-3 * np.isin(np.arange(len(s)), (20, 21))
    apart, together = lay_along(aside, None), lay_along(aside, s)
    assert np.abs(np.diff(apart.right)).max() > 3e-3
    assert np.abs(np.diff(together.right)).max() < 1.5e-3
    area = np.sum(column_widths(rows) * (together.w - w), axis=1)
    np.testing.assert_allclose(area, 40e-6, rtol=1e-9)


def test_a_stretch_does_not_depend_on_one_that_it_does_not_touch() -> None:
    u = np.arange(-12e-3, 12e-3, 0.25e-3)

    def lay_at(rows: Array) -> LaidBeads:
        s, one = 2e-3 * rows, np.ones(len(rows))
        slope = np.where(rows < 20, 1.2, -1.2)
        w = np.maximum(0.0, slope[:, None] * u)
        area = np.where(rows < 20, 20e-6, 45e-6) + 1e-6 * np.sin(rows)
        return lay_beads(
            BeadModel(), np.tile(u, (len(rows), 1)), w, centre=0.0 * one, width=10e-3 * one,
            area=area, tilt=0.0 * one, s=s,
        )  # fmt: skip

    first: Array = np.arange(10.0)
    for second in (np.arange(36.0, 50.0), np.arange(36.0, 37.0), np.arange(11.0, 12.0)):
        both = lay_at(np.append(first, second))
        np.testing.assert_allclose(both.w[:10], lay_at(first).w, atol=1e-12)
        np.testing.assert_allclose(both.w[10:], lay_at(second).w, atol=1e-12)
