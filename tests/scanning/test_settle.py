"""Laws of settling: what a burst shows of a sway, and scans on a carrier that sways."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cells import FAULTLESS, PAPER, Notes, example_corner_errors, scan_example
from hypothesis import given, settings
from hypothesis import strategies as st

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, inverse_pose, transform_points
from tjscan.job.files import read_scan_job
from tjscan.laser.profile import Profile
from tjscan.runs.scan.run import ScanContext
from tjscan.scanning.settle import StillGroove, fit_sway

NOISE = 5e-6
"""Metres, of a motion that is seen in one profile of 600 points."""

SECTIONS = 5
TOLERANCE_MM = 0.03


def carrier(frequency_hz: float = 3.0, **other: Any) -> dict[str, Any]:
    """A carrier that sways by about half a millimetre after a step."""
    mode = {"frequency_hz": frequency_hz, "damping": 0.01, "direction": [0.6, 0.5, 0.6]}
    return {
        "scan.sections": SECTIONS,
        "simulation.arm.sway.payload_kg": 2.0,
        "simulation.arm.sway.mode": [mode | {"mass_kg": 30.0} | other],
    }


SETTLED = {"scan.settle.tolerance_mm": TOLERANCE_MM}


def wedge(T_rest_s: Array, rng: np.random.Generator) -> Profile:
    """Two sides at 100 deg and noise, seen from a pose of s in the s of rest."""
    along = np.linspace(-0.03, 0.03, 600)
    x, z = along, 0.23 + 0.8 * np.abs(along)
    at = transform_points(inverse_pose(T_rest_s), np.column_stack((x, 0 * x, z)))
    return Profile(at[:, 0], at[:, 2] + 3e-5 * rng.standard_normal(len(x)))


@settings(deadline=None, max_examples=20)
@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_a_motion_in_the_plane_is_seen_as_it_is(x: float, z: float, turn: float) -> None:
    rng = np.random.default_rng(1)
    still = StillGroove([wedge(np.eye(4), rng) for _ in range(25)])
    moved = np.array((5e-4 * x, 5e-4 * z, 1e-3 * turn))
    truth = still.pose_of_motion(moved)
    profile = wedge(inverse_pose(truth), rng)
    found = still.motion(profile)
    np.testing.assert_allclose(found[:2], moved[:2], atol=4 * NOISE)
    assert found[2] == pytest.approx(moved[2], abs=3e-4)


def sway(times: Array, frequency: float, damping: float, phase: float) -> Array:
    w = 2 * np.pi * frequency
    x = 5e-4 * np.exp(-damping * w * times) * np.cos(w * times + phase)
    return np.column_stack((x, 0.5 * x, 0.1 * x))


@settings(deadline=None, max_examples=50)
@given(st.floats(2, 8), st.floats(0.0, 0.05), st.floats(0, 6.3), st.integers(0, 1000))
def test_the_place_of_rest_is_found_after_a_period_and_a_half(
    frequency: float, damping: float, phase: float, seed: int
) -> None:
    times = np.arange(0.0, 1.5 / frequency + 0.1, 0.01)
    noise = NOISE * np.random.default_rng(seed).standard_normal((len(times), 3))
    fit = fit_sway(times, sway(times, frequency, damping, phase) + noise)
    assert np.abs(fit.rest[:2]).max() < max(4 * fit.sigma, 1e-5)
    assert fit.sigma < 5e-5
    assert fit.frequency == pytest.approx(frequency, rel=0.15)


@pytest.mark.parametrize("frequency", [0.5, 1.0])
def test_a_sway_slower_than_those_that_are_looked_for_is_not_taken_for_known(
    frequency: float,
) -> None:
    times = np.arange(0.0, 2.0, 0.01)
    phase = 2 * np.pi * frequency * times
    motions = np.outer(np.cos(phase), (0.5e-3, 0.2e-3, 0.0))
    motions += 3e-6 * np.random.default_rng(1).standard_normal(motions.shape)
    fit = fit_sway(times[:90], motions[:90])
    assert fit.sigma > np.abs(fit.rest[:2]).max() / 3


def test_a_burst_shows_the_frequency_and_the_decay() -> None:
    times = np.arange(0.0, 1.5, 0.01)
    fit = fit_sway(times, sway(times, 4.0, 0.03, 1.0))
    assert fit.frequency == pytest.approx(4.0, rel=0.05)
    assert fit.damping == pytest.approx(0.03, rel=0.3)


def test_a_sway_makes_a_scan_worse_and_settling_mends_it() -> None:
    rigid = example_corner_errors(scan_example(FAULTLESS | {"scan.sections": SECTIONS}))
    as_it_arrives = example_corner_errors(scan_example(FAULTLESS | carrier()))
    notes = Notes()
    settled = example_corner_errors(scan_example(FAULTLESS | carrier() | SETTLED, notes=notes))
    assert as_it_arrives.max() > 3 * rigid.max()
    assert settled.max() < rigid.max() + 1e-3 * TOLERANCE_MM
    found = [detail for name, detail in notes.events if name == "sway"]
    assert len(found) == len(notes.views)
    frequencies = [float(detail.split(" at ")[1].split()[0]) for detail in found]
    assert frequencies == pytest.approx([3.0] * len(found), abs=0.25)


def test_without_faults_the_corners_are_off_by_what_is_tolerated() -> None:
    result = scan_example(FAULTLESS | carrier(2.0) | SETTLED)
    errors = 1e3 * example_corner_errors(result)
    # What the fit of curved sides leaves, and the place of rest in three standard deviations.
    assert errors.max() < 0.06 + 3 * TOLERANCE_MM
    for view in result.views:
        assert view.sway is not None
        assert 1e3 * view.sway[0] < TOLERANCE_MM


def test_a_cell_that_does_not_sway_waits_for_the_first_burst_alone() -> None:
    plain, settled = Notes(), Notes()
    scan_example({"scan.sections": SECTIONS}, notes=plain)
    scan_example({"scan.sections": SECTIONS} | SETTLED, notes=settled)
    waited = [one.views[-1].time - one.views[0].time for one in (settled, plain)]
    bursts = len(settled.views) - 1
    assert waited[0] - waited[1] < bursts * 0.26
    assert not [name for name, _ in settled.events if name == "sway"]


def test_without_the_table_a_profile_is_taken_as_the_arm_arrives() -> None:
    notes = Notes()
    scan_example({"scan.sections": SECTIONS}, notes=notes)
    assert all(view.sway is None for view in notes.views)


def test_the_same_seed_gives_the_same_scan_under_wind() -> None:
    first, again, other = (
        scan_example(carrier(wind_mm=0.2) | SETTLED | {"simulation.seed": seed, "scan.sections": 3})
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.sections[-1].points_b, again.sections[-1].points_b)
    assert (first.sections[-1].points_b != other.sections[-1].points_b).any()


def test_wind_that_never_ends_is_waited_for_no_longer_than_is_allowed() -> None:
    notes = Notes()
    keys = {"scan.settle.longest_s": 1.0, "scan.settle.tolerance_mm": 0.001, "scan.sections": 3}
    scan_example(carrier(wind_mm=0.3) | keys, notes=notes)
    assert all(view.sway is not None and view.sway[0] > 1e-6 for view in notes.views)
    assert all(b.time - a.time < 5.0 for a, b in zip(notes.views, notes.views[1:], strict=False))


def test_a_scan_that_never_rests_can_not_settle() -> None:
    with pytest.raises(ConfigurationError, match="never rests"):
        read_scan_job(PAPER, SETTLED | {"scan.mode": "continuous"})


def test_a_laser_without_bursts_can_not_settle(tmp_path: Any) -> None:
    keys = {"arm.driver": "replay", "laser.driver": "replay", "laser.recording": str(tmp_path)}
    job = read_scan_job(PAPER, SETTLED | keys)
    context = ScanContext(job, PAPER)
    with pytest.raises(ConfigurationError):
        context.make_cell()
