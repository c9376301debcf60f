"""A mistake in the start poses is found by undoing it: what is proposed passes, and only then."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cells import PAPER
from scipy.spatial.transform import Rotation

from tjscan.core.errors import ConfigurationError, PoseUnreachable
from tjscan.core.units import PoseSettings
from tjscan.job.files import ScanJob, read_scan_job
from tjscan.runs.scan.rehearsal import check_scan_job
from tjscan.runs.scan.run import ScanContext


def radians_as_degrees(one: PoseSettings) -> PoseSettings:
    return replace(one, euler_zyx=tuple(np.radians(one.euler_zyx).tolist()))


def order_reversed(one: PoseSettings) -> PoseSettings:
    return replace(one, euler_zyx=one.euler_zyx[::-1])


def rotation_vector(one: PoseSettings) -> PoseSettings:
    vector = Rotation.from_matrix(one.T[:3, :3]).as_rotvec()
    return replace(one, euler_zyx=tuple(np.radians(vector).tolist()))


def job_with_starts(first: PoseSettings, second: PoseSettings) -> ScanJob:
    job = read_scan_job(PAPER)
    return job.model_copy(update={"scan": replace(job.scan, first=first, second=second)})


@pytest.mark.parametrize(
    ("write", "name"),
    [
        (radians_as_degrees, "looks like radians: write second: "),
        (order_reversed, "roll, pitch, yaw"),
        (rotation_vector, "a rotation vector in radians"),
    ],
)
def test_an_orientation_written_otherwise_is_named_with_what_to_write(write, name) -> None:  # type: ignore[no-untyped-def]
    first, second = read_scan_job(PAPER).start_poses
    with pytest.raises(ConfigurationError, match=name) as refused:
        check_scan_job(ScanContext(job_with_starts(first, write(second)), PAPER))
    assert refused.value.key == "scan.second"
    assert "179.12" in str(refused.value)


def test_nothing_is_proposed_that_would_not_pass() -> None:
    first, second = read_scan_job(PAPER).start_poses
    away = replace(second, position=(5.0, 0.0, 0.0))
    with pytest.raises(PoseUnreachable):
        check_scan_job(ScanContext(job_with_starts(first, away), PAPER))


@pytest.mark.parametrize("same", [False, True])
def test_poses_that_do_not_lead_on_are_never_called_sound(*, same: bool) -> None:
    first, second = read_scan_job(PAPER).start_poses
    job = job_with_starts(second, second if same else first)
    with pytest.raises(ConfigurationError, match="too close" if same else "swap the two poses"):
        check_scan_job(ScanContext(job, PAPER))


def test_a_pose_in_metres_is_refused_before_anything_is_loaded(tmp_path: Path) -> None:
    file = tmp_path / "job.toml"
    text = PAPER.read_text(encoding="utf-8")
    file.write_text(text.replace("[-49.0, 807.9, 363.1]", "[-0.049, 0.8079, 0.3631]"))
    with pytest.raises(ConfigurationError, match=r"looks like metres: write \[-49\.0, 807\.9"):
        read_scan_job(file)
