"""``tjscan calibrate --lines ... --poses ...``: from options to files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from tjscan.calibration.arm.recorded import calibrate_recorded_arm, joint_angles_by_name
from tjscan.calibration.basis import BasisEntry, views_of_poses
from tjscan.calibration.file import SavedCalibration, to_calibration_file, write_calibration
from tjscan.calibration.fits.posed_profile import PosedProfile
from tjscan.calibration.fits.recorded import (
    pair_profiles_with_poses,
    read_flange_poses,
)
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.offline import TargetRecording, calibrate_from_profiles
from tjscan.cli.options.recorded import RecordedProfileOptions
from tjscan.cli.options.recorded_targets import read_target, target_words
from tjscan.cli.output.calibration import finish_calibration
from tjscan.cli.output.console import print_message
from tjscan.core.config import validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.provenance import Provenance
from tjscan.laser.files.format import ProfileFormat
from tjscan.laser.files.read import read_profiles
from tjscan.result.directory import CALIBRATION_FILE
from tjscan.robot.kinematics import Kinematics
from tjscan.runs.run import default_run_directory

NOISE: Final = (
    "range_mm",
    "correlation_columns",
    "position_mm",
    "rotation_deg",
    "touch_mm",
    "geometry_mm",
)
UNNAMED: Final = "unnamed"


def calibrate_recorded(options: RecordedProfileOptions, out: Path | None, *, json: bool) -> None:
    """Calibrate from recorded profiles, report, and write ``calibration.toml``.

    Raises
    ------
    ConfigurationError
        If options don't fit together, or a file is missing or wrong.
    CalibrationRefused
        If the result could not be trusted.
    """
    if options.lines is None or options.poses is None:
        raise ConfigurationError("recorded profiles need both --lines and --poses")
    if len(options.lines) != len(options.poses):
        raise ConfigurationError(
            f"each --lines has its --poses (found: {len(options.lines)} and {len(options.poses)})"
        )
    file = (out or default_run_directory(options.lines[0])) / CALIBRATION_FILE
    if file.exists():
        raise ConfigurationError("stands there already; choose another --out", file=file)
    if options.arm_model is not None and options.fixed_sensor:
        raise ConfigurationError("--arm-model calibrates an arm that carries the sensor")
    noise = _noise(options)
    words = target_words(options, len(options.lines))
    recordings, read_as = [], []
    left_out: list[str] = []

    def leave_out(message: str) -> None:
        print_message(message)
        left_out.append(message)

    kinds = [word.partition("=")[0] for word in words]
    for k, (lines, poses, word) in enumerate(zip(options.lines, options.poses, words, strict=True)):
        shots, convention = _shots(options, lines, poses, leave_out)
        read_as.append(f"{poses.name}: {convention}")
        if len(words) > 1:
            which = kinds[k]
            if kinds.count(which) > 1:
                which += f" {kinds[: k + 1].count(which)},"
            shots = [replace(shot, name=f"{which} {shot.name}") for shot in shots]
        recordings.append(TargetRecording(shots, read_target(word, shots, noise)))
    arm = None if options.arm_model is None else Kinematics.load(options.arm_model)
    if arm is not None:
        joint_angles_by_name(recordings, arm)  # before anything is solved
    result = calibrate_from_profiles(
        recordings, noise, leave_out, sensor_is_fixed=options.fixed_sensor
    )
    kinematics = None
    if arm is not None:
        result, kinematics = calibrate_recorded_arm(
            recordings, arm, noise, result.T_f_s, print_message
        )
    seen = {shot.name: shot.T_b_f for one in recordings for shot in one.profiles}
    found = to_calibration_file(
        result,
        noise,
        arm=options.arm_id or UNNAMED,
        laser=options.laser_id or UNNAMED,
        date=datetime.now(UTC).replace(microsecond=0),
        kinematics=kinematics,
        basis=BasisEntry(
            target="; ".join(words),
            poses_read_as=tuple(read_as),
            left_out=tuple(left_out),
            caveats=result.caveats,
            views=views_of_poses(seen, result.T_f_s, sensor_is_fixed=options.fixed_sensor),
        ),
    )
    write_calibration(
        file,
        found,
        Provenance.for_file_written_now(
            options.lines[0].name, "b" if options.fixed_sensor else "f"
        ),
    )
    finish_calibration(SavedCalibration(file, found, result.caveats), json=json)
    if options.arm_id is None or options.laser_id is None:
        print_message(
            "name the devices with --arm-id and --laser-id, or a scan will refuse that file"
        )


def _shots(
    options: RecordedProfileOptions, lines: Path, poses: Path, leave_out: Callable[[str], None]
) -> tuple[list[PosedProfile], str]:
    """Profiles with their poses, and how the poses were read."""
    # Heights count as they stand: where the sensor's origin lies is what is calibrated.
    invalid = tuple(options.invalid or ())
    form = ProfileFormat(options.units, options.pitch, invalid, z_offset=0.0)
    table = read_profiles(lines, form)
    for bad in table.bad:
        leave_out(f"{lines}: {bad}; left out")
    found = read_flange_poses(poses)
    print_message(f"{poses}: {len(found.T_b_f)} poses, read as {found.convention}")
    return pair_profiles_with_poses(table.profiles, found, poses), found.convention


def _noise(options: RecordedProfileOptions) -> NoiseModel:
    stated = {name: getattr(options, name) for name in NOISE}
    return validate_table(NoiseModel, {k: v for k, v in stated.items() if v is not None})
