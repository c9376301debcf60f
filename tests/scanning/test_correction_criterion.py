"""A correction is skipped where it would change little, and the scan is as good without it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cells import CLOCKWISE, FAULTLESS, PAPER, example_corner_errors, scan_example
from command import tjscan
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rings import GROOVE, PLAN, ring_section
from scipy.spatial.transform import Rotation

from tjscan.core.frames import Array, pose
from tjscan.groove.read import read_groove
from tjscan.job.files import read_scan_job
from tjscan.recording.parts import recording_files
from tjscan.scanning.journal import StopReason
from tjscan.scanning.plan import CorrectionCriterion, view_deviation, view_deviation_sigmas
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import SetPoint, Substep
from tjscan.scanning.target import ScanDirection, correction_target_pose

ANGLE = 0.175
SKIPPING = {"scan.skip.enabled": True}
IDEAL = SetPoint(ring_section(ANGLE).T_b_t, PLAN.target_pose_in_sensor(GROOVE.work_angle))
offs = arrays(np.float64, 6, elements=st.floats(-0.3, 0.3))


def change(off: Array) -> Array:
    return pose(Rotation.from_rotvec(off[3:]).as_matrix(), off[:3])


@given(offs)
def test_a_deviation_is_how_far_frame_t_is_off(off: Array) -> None:
    taken = ring_section(ANGLE, off=change(off))
    np.testing.assert_allclose(view_deviation(taken, IDEAL), off, atol=1e-9)


def test_a_raised_sensor_and_a_smaller_work_angle_are_the_same_deviation() -> None:
    for direction, sign in ((ScanDirection.COUNTERCLOCKWISE, 1), (ScanDirection.CLOCKWISE, -1)):
        plan = replace(PLAN, direction=direction)
        taken = ring_section(ANGLE, plan=plan)
        wanted = SetPoint(taken.T_b_t, plan.target_pose_in_sensor(GROOVE.work_angle + 0.02))
        off = view_deviation(taken, wanted)
        assert off[3] == pytest.approx(sign * 0.02, abs=1e-9)


@given(offs, arrays(np.float64, 6, elements=st.floats(0, 0.05)), st.floats(0, 1))
def test_what_is_nearer_and_surer_is_allowed_where_the_further_is(
    off: Array, sigma: Array, share: float
) -> None:
    skip = CorrectionCriterion(True, 0.2, 0.2, 0.2)
    if skip.allows_skipping(off, sigma):
        assert skip.allows_skipping(share * off, sigma)
        assert skip.allows_skipping(off, share * sigma)
    assert not skip.allows_skipping(off + 1.0, sigma)


def test_reading_and_prediction_together_are_surer_than_either() -> None:
    direction = ScanDirection.COUNTERCLOCKWISE
    alone = view_deviation_sigmas(GROOVE, SetPoint(np.eye(4), np.eye(4)), 0.04, direction)
    P = np.diag([(1e-4) ** 2] * 3 + [1e-6] * 4)
    both = view_deviation_sigmas(GROOVE, SetPoint(np.eye(4), np.eye(4), P), 0.04, direction)
    assert (both < alone).all()
    assert (both**2 < [1e-8] * 3 + [2e-6, 1e-6, 1e-6]).all()
    certain = SetPoint(np.eye(4), np.eye(4), np.zeros((7, 7)))
    assert (view_deviation_sigmas(GROOVE, certain, 0.04, direction) == 0).all()


def test_a_shorter_step_tells_the_direction_of_motion_less_well() -> None:
    ahead = SetPoint(np.eye(4), np.eye(4))
    short, long = (
        view_deviation_sigmas(GROOVE, ahead, step, ScanDirection.COUNTERCLOCKWISE)
        for step in (0.01, 0.1)
    )
    assert short[4:] == pytest.approx(10 * long[4:])


def test_the_papers_cases_always_correct_unless_the_job_says_otherwise() -> None:
    assert read_scan_job(PAPER).scan.correction_criterion is None
    skip = read_scan_job(PAPER, SKIPPING | {"scan.skip.position_mm": 3.0}).scan.correction_criterion
    assert skip is not None
    assert skip.position == pytest.approx(3e-3)


@pytest.mark.parametrize("file", [PAPER, CLOCKWISE], ids=["ccw", "cw"])
@pytest.mark.parametrize("step_mm", [20, 40, 70])
def test_a_scan_that_skips_is_as_good_with_fewer_views(file: Path, step_mm: int) -> None:
    keys = {"scan.prediction_case": 2, "scan.step_mm": step_mm, "scan.length_mm": 280.0}
    full, quick = (scan_example(keys | more, file=file) for more in ({}, SKIPPING))
    assert quick.stop is full.stop is StopReason.LENGTH
    assert len(quick.views) < len(full.views)
    # A corner is seen as well from 5° beside.
    assert (
        example_corner_errors(quick, file).mean() < example_corner_errors(full, file).mean() + 2e-5
    )
    plan = read_scan_job(file, keys | SKIPPING).scan
    assert plan.correction_criterion is not None
    for before, scan in zip(quick.sections[1:], quick.sections[2:], strict=False):
        if scan.view.substep is Substep.PREDICTION:
            ideal = SetPoint(
                correction_target_pose(before.T_b_g, scan.T_b_g),
                plan.target_pose_in_sensor(scan.groove.work_angle),
            )
            assert plan.correction_criterion.allows_skipping(
                view_deviation(scan, ideal), np.zeros(6)
            )


def test_nothing_is_skipped_where_nothing_is_tolerated() -> None:
    keys = SKIPPING | {
        "scan.skip.position_mm": 1e-6,
        "scan.skip.work_angle_deg": 1e-6,
        "scan.skip.rotation_deg": 1e-6,
        "scan.sections": 6,
    }
    result = scan_example(keys)
    assert {s.view.substep for s in result.sections[2:]} == {Substep.CORRECTION}


def test_a_scan_that_skips_goes_on_as_if_it_had_not_been_cut(tmp_path: Path) -> None:
    keys = FAULTLESS | SKIPPING | {"scan.prediction_case": 2, "scan.length_mm": 240.0}
    options = [word for key, value in keys.items() for word in (f"--{key}", str(value).lower())]
    run = tmp_path / "run"
    assert tjscan("scan", PAPER, "--out", run, *options) == 0
    whole = read_recorded_scan(run).reread_sections(read_groove)
    assert Substep.PREDICTION in {scan.view.substep for scan in whole}
    recording = recording_files(run)[0]
    recording.write_bytes(recording.read_bytes()[: recording.stat().st_size // 2])
    assert tjscan("scan", "--resume", run) == 0
    again = read_recorded_scan(run).reread_sections(read_groove)
    assert [s.view.substep for s in again] == [s.view.substep for s in whole]
    for one, other in zip(again, whole, strict=True):
        np.testing.assert_allclose(one.points_b, other.points_b, atol=1e-12)
        np.testing.assert_allclose(one.T_b_t, other.T_b_t, atol=1e-12)
