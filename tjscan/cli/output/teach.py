"""What ``tjscan teach`` prints."""

from __future__ import annotations

from json import dumps
from pathlib import Path

from tjscan.cli.output.console import print_message
from tjscan.result.readings import measures_with_sigmas
from tjscan.runs.teach import TaughtPose, Which


def print_taught_pose(taught: TaughtPose, job_file: Path, which: Which, *, json: bool) -> None:
    """Print the groove that is seen and the pose that was written, on stderr; the pose as JSON."""
    position, angles = taught.position_mm, taught.euler_zyx_deg
    if json:
        pose = {"which": which, "position_mm": position, "euler_zyx_deg": angles}
        print(dumps(pose, indent=2))
    seen = ", ".join(
        f"{name} {value:.2f}" for name, value, _ in measures_with_sigmas(taught.groove)
    )
    print_message(f"the laser sees a groove there: {seen}")
    print_message(f"{job_file}: {'.'.join(taught.key)} is now {list(position)} mm, {list(angles)}°")
