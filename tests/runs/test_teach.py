"""A pose is taught from where the arm stands, into the job file as it is."""

from __future__ import annotations

import json
import stat
from pathlib import Path

import numpy as np
import pytest
from cells import EXAMPLES
from command import tjscan
from hypothesis import given, settings
from hypothesis import strategies as st
from taught import HALF_DIGIT, example, standing

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import pose, pose_from_euler_zyx, rot_y, rotation_angle_between
from tjscan.core.units import MM
from tjscan.job.files import read_scan_job
from tjscan.runs.teach import pose_for_job_file, write_start_pose


@pytest.mark.parametrize("which", ["first", "second"])
def test_the_pose_written_is_the_pose_read_and_all_else_stays(
    tmp_path: Path, which: str, capsys: pytest.CaptureFixture[str]
) -> None:
    job = example(tmp_path, EXAMPLES / "ur10e.toml")
    before, old = job.read_text(encoding="utf-8"), read_scan_job(job)
    T = read_scan_job(job).start_poses[0].T
    stands = pose(T[:3, :3] @ rot_y(0.02), T[:3, 3] + (0.003, -0.012, 0.004))
    home = standing(stands)
    assert tjscan("teach", job, "--which", which, "--simulation.arm.home_deg", home, "--json") == 0
    new, told = read_scan_job(job), json.loads(capsys.readouterr().out)
    found = new.start_poses[which == "second"]
    assert np.abs(found.T[:3, 3] - stands[:3, 3]).max() < HALF_DIGIT[0]
    assert rotation_angle_between(found.T, stands) < 2 * HALF_DIGIT[1]
    assert tuple(told["position_mm"]) == MM.to_file(found.position)
    assert new.model_copy(update={"scan": old.scan}) == old
    changed = [
        (a, b)
        for a, b in zip(before.splitlines(), job.read_text("utf-8").splitlines(), strict=True)
        if a != b
    ]
    assert [a.split()[0] for a, _ in changed] == ["position_mm", "euler_zyx_deg"]
    assert list(tmp_path.iterdir()) == [job]


def test_where_the_laser_sees_no_groove_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = example(tmp_path)
    before = job.read_bytes()
    assert tjscan("teach", job, "--which", "second") == 4
    assert "at the second taught pose, no groove found" in capsys.readouterr().err
    assert job.read_bytes() == before


def test_inline_tables_comments_links_and_permissions_stay(tmp_path: Path) -> None:
    job = example(tmp_path)
    text = job.read_text(encoding="utf-8")
    head, _, rest = text.partition("[scan.first]")
    _, _, rest = rest.partition("[arm]")
    inline = (
        "first = { position_mm = [101, 2, 3], euler_zyx_deg = [4, 5, 6] } # by hand\n"
        "second = { position_mm = [101, 2, 3], euler_zyx_deg = [4, 5, 6] }\n[arm]"
    )
    job.write_text(head + inline + rest, encoding="utf-8")
    job.chmod(0o640)
    link = tmp_path / "link.toml"
    link.symlink_to(job)
    write_start_pose(link, ("scan", "first"), (107.5, 8.0, 9.0), (1.0, -2.0, 3.0))
    text = job.read_text(encoding="utf-8")
    assert "# by hand" in text
    assert text.startswith(head)
    assert text.endswith(rest)
    assert link.is_symlink()
    assert stat.S_IMODE(job.stat().st_mode) == 0o640
    assert read_scan_job(link).start_poses[0].position == pytest.approx((107.5e-3, 8.0e-3, 9.0e-3))
    assert read_scan_job(link).start_poses[1].position == pytest.approx((101.0e-3, 2.0e-3, 3.0e-3))


@settings(max_examples=50)
@given(
    position=st.tuples(*[st.floats(-5, 5)] * 3),
    angles=st.tuples(*[st.floats(-3.14, 3.14)] * 3),
)
def test_any_pose_survives_being_written(
    position: tuple[float, ...], angles: tuple[float, ...]
) -> None:
    T = pose_from_euler_zyx(position, angles)
    position_mm, euler_zyx_deg = pose_for_job_file(T)
    again = pose_from_euler_zyx(1e-3 * np.array(position_mm), np.radians(euler_zyx_deg))
    assert np.abs(again[:3, 3] - T[:3, 3]).max() <= HALF_DIGIT[0]
    assert rotation_angle_between(again, T) <= 2 * HALF_DIGIT[1]


def test_a_file_that_is_no_job_any_more_is_left_alone(tmp_path: Path) -> None:
    job = tmp_path / "job.toml"
    for text in ("scan = 3", "[scan]\nfirst = 3", "[scan", "[scan]\n[scan.first]\n"):
        job.write_text(text, encoding="utf-8")
        with pytest.raises(ConfigurationError, match=str(job)):
            write_start_pose(job, ("scan", "first"), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        assert job.read_text(encoding="utf-8") == text


def test_a_simulated_arm_is_led_from_the_pose_in_the_job(tmp_path: Path) -> None:
    job = example(tmp_path)
    before = read_scan_job(job).start_poses
    assert tjscan("teach", job, "--which", "second", "--lead-mm", 3, -1, 2) == 0
    first, second = read_scan_job(job).start_poses
    moved = before[1].T[:3, :3].T @ (second.T[:3, 3] - before[1].T[:3, 3])
    assert moved == pytest.approx([3e-3, -1e-3, 2e-3], abs=2 * HALF_DIGIT[0])
    assert rotation_angle_between(second.T, before[1].T) < 2 * HALF_DIGIT[1]
    assert first == before[0]


def test_no_real_arm_is_led(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    job = example(tmp_path)
    options = ("--arm.driver", "ur", "--arm.ur.host", "127.0.0.1", "--lead-mm", 1, 0, 0)
    assert tjscan("teach", job, "--which", "second", *options) == 2
    assert "leads a simulated arm alone" in capsys.readouterr().err
