"""``tjscan calibrate --lines ... --poses ...``: from options to files."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from tjscan.calibration.file import SavedCalibration, to_calibration_file, write_calibration
from tjscan.calibration.noise import NoiseModel
from tjscan.calibration.offline import calibrate_from_profiles
from tjscan.calibration.plucker import PluckerPlane
from tjscan.calibration.posed_profile import PosedProfile
from tjscan.calibration.recorded import (
    pair_profiles_with_poses,
    read_flange_poses,
    read_points_in_base_frame,
)
from tjscan.calibration.targets import PlaneTarget, SphereTarget, fit_plane, plane_stated_beforehand
from tjscan.cli.calibration_output import print_calibration
from tjscan.cli.console import print_message
from tjscan.cli.recorded_options import RecordedProfileOptions, comma_separated_options
from tjscan.core.config import validate_table
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.provenance import Provenance
from tjscan.laser.files import ProfileFormat, read_profiles
from tjscan.result.directory import CALIBRATION
from tjscan.runs.directory import default_run_directory

TARGETS: Final = ("plane", "touched", "unknown_plane", "sphere_radius_mm", "unknown_sphere")
NOISE: Final = ("range_mm", "correlation_columns", "position_mm", "rotation_deg", "touch_mm")
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
    file = (out or default_run_directory(options.lines)) / CALIBRATION
    if file.exists():
        raise ConfigurationError("stands there already; choose another --out", file=file)
    noise = _noise(options)
    shots = _shots(options, options.lines, options.poses)
    result = calibrate_from_profiles(shots, _target(options, shots, noise), noise, print_message)
    found = to_calibration_file(
        result,
        noise,
        arm=options.arm_id or UNNAMED,
        laser=options.laser_id or UNNAMED,
        date=datetime.now(UTC).replace(microsecond=0),
    )
    write_calibration(file, found, Provenance.for_file_written_now(options.lines.name, "f"))
    print_calibration(SavedCalibration(file, found, result.caveats), json=json)
    if options.arm_id is None or options.laser_id is None:
        print_message(
            "name the devices with --arm-id and --laser-id, or a scan will refuse that file"
        )


def _shots(options: RecordedProfileOptions, lines: Path, poses: Path) -> list[PosedProfile]:
    # Heights count as they stand: where the sensor's origin lies is what is calibrated.
    invalid = tuple(options.invalid or ())
    form = ProfileFormat(options.units, options.pitch, invalid, z_offset=0.0)
    table = read_profiles(lines, form)
    for bad in table.bad:
        print_message(f"{lines}: {bad}; left out")
    return pair_profiles_with_poses(table.profiles, read_flange_poses(poses), poses)


def _noise(options: RecordedProfileOptions) -> NoiseModel:
    stated = {name: getattr(options, name) for name in NOISE}
    return validate_table(NoiseModel, {k: v for k, v in stated.items() if v is not None})


def _target(
    options: RecordedProfileOptions, shots: list[PosedProfile], noise: NoiseModel
) -> PlaneTarget | SphereTarget | None:
    given = [name for name in options.given_option_names if name in TARGETS]
    if len(given) != 1:
        raise ConfigurationError(
            f"what the laser looked at takes one of {comma_separated_options(TARGETS)} "
            f"(found: {comma_separated_options(given) or 'none'})"
        )
    flange_b = np.mean([shot.T_b_f[:3, 3] for shot in shots], axis=0)
    if options.plane is not None:
        return plane_stated_beforehand(_plane(options.plane), flange_b, noise.touch)
    if options.touched is not None:
        return fit_plane(read_points_in_base_frame(options.touched), noise.touch, flange_b)
    if options.unknown_plane:
        return None
    radius = options.sphere_radius_mm
    if radius is not None and not 0 < radius < np.inf:
        raise ConfigurationError("a ball has a positive radius", key="--sphere-radius-mm")
    return SphereTarget(None if radius is None else 1e-3 * radius)


def _plane(text: str) -> PluckerPlane:
    """A x + B y + C z + D = 0, D in millimetres."""
    try:
        numbers: Array = np.array([float(part) for part in text.split(",")])
        if numbers.shape != (4,) or not np.isfinite(numbers).all():
            raise ValueError("four finite numbers are needed")
        return PluckerPlane(numbers[:3], 1e-3 * float(numbers[3]))
    except ValueError as error:
        raise ConfigurationError(
            f"{text!r} is no plane A,B,C,D in millimetres: {error}", key="--plane"
        ) from None
