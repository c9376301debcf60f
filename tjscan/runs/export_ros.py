"""Write a scan for programs of ROS 2: its sections, and where the arm was to measure them."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.core.errors import ConfigurationError, RecordingError
from tjscan.core.files import write_files_atomically
from tjscan.core.frames import inverse_pose
from tjscan.job.files import read_scan_job
from tjscan.recording.ros import (
    bag_metadata,
    joint_trajectory_message,
    pose_array_message,
    write_ros_messages,
)
from tjscan.result.directory import JOB_FILE, URDF_FILE
from tjscan.result.export import EXPORT_FILE_STEM
from tjscan.result.shapes import read_finished_sections
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.scan.run import result_frame_of_job
from tjscan.scanning.recording import read_recorded_scan
from tjscan.scanning.section import ProfileView

ROS_BAG_FILE: Final = f"{EXPORT_FILE_STEM}.mcap"


def export_run_to_ros(directory: Path, out: Path | None = None) -> Path:
    """Write a scan as messages of ROS 2, in JSON and in MCAP, and return their folder.

    Sections and flange poses are in the arm's base frame, which has its name in the URDF that
    is beside them.

    Parameters
    ----------
    directory : Path
        The run directory of one scan.
    out : Path, optional
        The folder to write; ``export.ros`` in the run directory if left out.

    Raises
    ------
    ConfigurationError
        If there is no finished run, it is stitched, or the folder can't be made: there is none
        to make it in, or a file has its name.
    RecordingError
        If the recording is damaged, or the arm's clock restarted in it, or a file can't be
        written.
    """
    summary, sections = read_finished_sections(directory)
    if summary.stations:
        raise ConfigurationError(
            "is stitched from several stations, each with an arm base of its own: export the run "
            "directory of each station",
            file=directory,
        )
    folder = out or directory / f"{EXPORT_FILE_STEM}.ros"
    if not folder.parent.is_dir():
        raise ConfigurationError(
            "there is no folder to make it in: make that first", file=folder, key="--out"
        )
    if folder.is_file():
        raise ConfigurationError("a file is in the way: name a folder", file=folder, key="--out")
    job = read_scan_job(directory / JOB_FILE)
    arm, T_b_r = Kinematics.load(job.arm.model), inverse_pose(result_frame_of_job(job).T_r_b)
    views, time = _read_views_in_time_order(directory)
    T_b_g = np.array([T_b_r @ section.T_r_g for section in sections])
    T_b_f, q = np.array([view.T_b_f for view in views]), np.array([view.q for view in views])
    seconds = np.array([view.time - views[0].time for view in views])
    messages = {
        "/sections": pose_array_message(time, arm.base_name, T_b_g),
        "/flange": pose_array_message(time, arm.base_name, T_b_f),
        "/joint_trajectory": joint_trajectory_message(time, arm.joint_names, q, seconds),
    }
    with write_files_atomically(folder) as draft:
        for topic, message in messages.items():
            text = json.dumps(message.fields, indent=1, allow_nan=False)
            (draft / f"{topic.strip('/')}.json").write_text(f"{text}\n", encoding="utf-8")
        with (draft / ROS_BAG_FILE).open("wb") as file:
            write_ros_messages(file, time, messages)
        metadata = bag_metadata(ROS_BAG_FILE, time, messages)
        (draft / "metadata.yaml").write_text(json.dumps(metadata, indent=1) + "\n", "utf-8")
        (draft / URDF_FILE).write_bytes(arm.urdf.read_bytes())
    return folder


def _read_views_in_time_order(directory: Path) -> tuple[list[ProfileView], int]:
    """The views of a recording, and nanoseconds from 1970 to when it began.

    Of several at one time, when a profile was taken again on the spot, the first counts.
    """
    scan = read_recorded_scan(directory)
    if scan.started is None or not scan.views:
        raise RecordingError(f"{directory}: its recording holds no profile")
    views = [scan.views[0]]
    for view in scan.views[1:]:
        if view.time < views[-1].time:
            raise RecordingError(
                f"{directory}: the arm's clock restarted when the scan was resumed, so its "
                "trajectory has no times"
            )
        if view.time > views[-1].time:
            views.append(view)
    since = scan.started - datetime.fromtimestamp(0, UTC)
    return views, since // timedelta(microseconds=1) * 1000
