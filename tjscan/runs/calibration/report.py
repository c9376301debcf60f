"""What a report shows of a calibration: a chapter beside a scan, and a page of its own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from tjscan.calibration.file import (
    ArmKinematicsEntry,
    BasisEntry,
    CalibrationFile,
    read_calibration,
)
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError
from tjscan.core.manifest import check_files_unaltered
from tjscan.job.files import read_calibration_job
from tjscan.result.chapter import HeadlineNumber, ReportChapter, ReportChart, ReportSheet
from tjscan.result.directory import CALIBRATION_FILE, CALIBRATION_PICTURE, JOB_FILE
from tjscan.runs.scan.results import calibration_label


def calibration_chapter(directory: Path) -> ReportChapter:
    """Make the calibration's chapter of a report; see `tjscan.result.chapter.ChapterWriter`."""
    file = directory / CALIBRATION_FILE
    if not file.is_file():
        finding = (
            "The sensor's pose on the flange is stated in the job and was not calibrated with this "
            "program: its error is in every point, and is not known."
        )
        fact = "stated in the job; its uncertainty is not known"
        return ReportChapter(facts=(("calibration", fact),), findings=(finding,))
    found = read_calibration(file)
    fact = (
        f"{calibration_label(directory)}, {found.lines} lines: the sensor's pose on the flange is "
        f"known to {found.sigma_position_mm:.3f} mm and {found.sigma_rotation_deg:.4f}° (one "
        "standard deviation)"
    )
    return ReportChapter(facts=(("calibration", fact),))


EMPTY_CALIBRATION_BASIS: Final = BasisEntry(target="")
"""Of a calibration whose file does not hold what it rests on."""

MOST_LISTED_LEFT_OUT_PROFILES: Final = 4
"""Profiles left out that the page names; the file names all."""

USED_PROFILES_LABEL: Final = "in use"
LEFT_OUT_PROFILES_LABEL: Final = "left out"


def calibration_page(directory: Path) -> ReportChapter:
    """Make the page of a calibration's directory; see `tjscan.result.chapter.ChapterWriter`."""
    file = directory / CALIBRATION_FILE
    if not file.is_file():
        raise ConfigurationError(
            "holds a calibration that is not finished; go on with it: "
            f"tjscan calibrate --resume {directory}",
            file=directory,
        )
    check_files_unaltered(directory / JOB_FILE, file)
    found = read_calibration(file)
    frame = "f" if found.T_b_s_mm is None else "b"
    sheet = ReportSheet("Calibration", CALIBRATION_PICTURE, frame)
    facts, charts = tuple(_calibration_facts(found)), tuple(_calibration_charts(found))
    findings = tuple(_calibration_findings(directory, found))
    headline = tuple(HeadlineNumber(value, what) for what, value in _pose_headline(found))
    return ReportChapter(facts, findings, charts, headline=headline, sheet=sheet)


def _pose_headline(found: CalibrationFile) -> Iterator[tuple[str, str]]:
    """The sensor's pose, each number with its standard uncertainty."""
    sigma = np.sqrt(np.diag(found.covariance))
    rows = np.array(found.sensor_pose_rows)
    turn = Rotation.from_matrix(rows[:3, :3]).as_rotvec(degrees=True)
    where = "on the flange" if found.T_b_s_mm is None else "in the arm's base"
    for axis, value, spread in zip("xyz", rows[:3, 3], sigma[:3], strict=True):
        yield f"{axis} of the sensor {where}", f"{value:.3f} ± {spread:.3f} mm"
    for axis, value, spread in zip("xyz", turn, sigma[3:], strict=True):
        yield f"rotation vector, {axis}", f"{value:.4f} ± {spread:.4f}°"
    both = f"{found.sigma_position_mm:.3f} mm, {found.sigma_rotation_deg:.4f}°"
    yield "standard uncertainty, all axes together", both
    if found.kinematics is not None:
        arm = found.kinematics
        yield (
            f"{arm.held_out_poses} poses held out, the arm as stated → as calibrated",
            f"{arm.held_out_before_mm:.3f} → {arm.held_out_after_mm:.3f} mm RMS",
        )


def _calibration_facts(found: CalibrationFile) -> Iterator[tuple[str, str]]:
    basis = found.basis or EMPTY_CALIBRATION_BASIS
    yield "devices", f"arm {found.arm}, laser {found.laser}, {found.date:%Y-%m-%d %H:%M} UTC"
    target = basis.target or "not kept by the version that wrote the file"
    yield "target", f"{target}; {found.method}"
    yield (
        "profiles",
        f"{found.lines} in use; left out: {len(found.residuals) - found.lines} as contradicting "
        f"the others, {len(basis.left_out)} before that",
    )
    yield (
        "condition number",
        f"{found.condition:.1f}"
        + ("; about 10 is good, 100 is refused" if found.method == "plane touched" else ""),
    )
    if (ball := found.ball) is not None:
        stated = ball.stated_radius_mm
        yield (
            "radius of the ball",
            f"measured {ball.measured_radius_mm:.3f} ± {ball.sigma_radius_mm:.3f} mm, "
            + ("none stated" if stated is None else f"stated {stated:.3f} mm"),
        )
    if basis.poses_read_as:
        yield "poses read as", "; ".join(basis.poses_read_as)
    used = [residual for residual in found.residuals if residual.used]
    rms = np.sqrt(np.mean(np.array([residual.offset_mm for residual in used]) ** 2))
    worst = max(used, key=lambda residual: abs(residual.offset_mm))
    largest = f"largest {worst.offset_mm:+.3f} mm ({worst.name})"
    yield "residuals in use", f"{rms:.3f} mm RMS, {largest}"
    if (fresh := found.verification) is not None:
        yield (
            "a fresh line",
            f"{fresh.offset_mm:+.3f} mm and {fresh.tilt_deg:+.4f}° off; {fresh.misfit:.1f} "
            f"standard deviations, {fresh.limit:.1f} may be",
        )
    noise = found.noise
    yield (
        "errors stated",
        f"range {1e3 * noise.range:g} mm, pose {1e3 * noise.position:g} mm and "
        f"{np.degrees(noise.rotation):.3g}° each axis, touch {1e3 * noise.touch:g} mm; the arm's "
        f"geometry is allowed {found.geometry_mm:.2g} mm",
    )
    if found.kinematics is not None:
        yield "arm", _calibrated_arm_in_words(found.kinematics)


def _calibrated_arm_in_words(arm: ArmKinematicsEntry) -> str:
    left = arm.left_as_stated
    return (
        f"{arm.model}: six deviations of each of {len(arm.deviations)} joints; left as the maker "
        "states: "
        + ("; ".join(line.removesuffix(": left as the maker states") for line in left) or "none")
    )


def _calibration_findings(directory: Path, found: CalibrationFile) -> Iterator[str]:
    if (file := directory / JOB_FILE).is_file():
        job = read_calibration_job(file)
        if {job.arm.driver_kind, job.laser.driver_kind} == {DriverKind.SIMULATED}:
            yield "Simulated: no real arm or laser measured this."
    if found.T_b_s_mm is not None:
        yield "The sensor is fixed in the room: this is its pose in the arm's base."
    basis = found.basis or EMPTY_CALIBRATION_BASIS
    for line in (*basis.caveats, *basis.left_out[:MOST_LISTED_LEFT_OUT_PROFILES]):
        yield f"{line[:1].upper()}{line[1:]}."
    if (more := len(basis.left_out) - MOST_LISTED_LEFT_OUT_PROFILES) > 0:
        yield f"{more} more were left out; {CALIBRATION_FILE} names them."


def _calibration_charts(found: CalibrationFile) -> Iterator[ReportChart]:
    used = np.array([residual.used for residual in found.residuals])
    misfit = np.array([residual.misfit for residual in found.residuals])
    numbers = np.arange(1, len(used) + 1)
    caption = "Offset and tilt together, against what the noise stated lets one expect: dashed."
    title = "residual of each profile"
    labels = "profile, in their order", "residual / standard deviations"
    for which, line, expected in (
        (used, USED_PROFILES_LABEL, 1.0),
        (~used, LEFT_OUT_PROFILES_LABEL, None),
    ):
        if which.any():
            x, y = numbers[which], misfit[which]
            yield ReportChart(title, *labels, x, y, expected, line, caption, mark="bar")
    yield from _charts_of_tilts(found)
    yield from _charts_of_uncertainty(found)


def _charts_of_tilts(found: CalibrationFile) -> Iterator[ReportChart]:
    used = {
        one.name: USED_PROFILES_LABEL if one.used else LEFT_OUT_PROFILES_LABEL
        for one in found.residuals
    }
    frame = "the arm's base" if found.T_b_s_mm is None else "the flange"
    caption = (
        f"A dot for each profile: its distance from the origin is the tilt from z of {frame}, its "
        "direction the azimuth."
    )
    # An arm's calibration solves with some of its profiles, and is checked by the others.
    other = LEFT_OUT_PROFILES_LABEL if found.kinematics is None else "others"
    shown: dict[str, list[tuple[float, float]]] = {USED_PROFILES_LABEL: []}
    for view in (found.basis or EMPTY_CALIBRATION_BASIS).views:
        place = view.tilt_deg, np.radians(view.azimuth_deg)
        shown.setdefault(used.get(view.name, other), []).append(place)
    for line, places in shown.items():
        if places:
            tilt, azimuth = np.array(places).T
            x, y = tilt * np.cos(azimuth), tilt * np.sin(azimuth)
            words = "how the sensor was tilted", "towards x / °", "towards y / °"
            yield ReportChart(*words, x, y, None, line, caption, plane=True, mark="dot")


def _charts_of_uncertainty(found: CalibrationFile) -> Iterator[ReportChart]:
    steps = (found.basis or EMPTY_CALIBRATION_BASIS).shrinking
    title, caption = "uncertainty over the number of lines", "Of the result, after each line."
    lines = np.array([step.lines for step in steps])
    for line, values in (
        ("position / mm", np.array([step.sigma_position_mm for step in steps])),
        ("rotation / °", np.array([step.sigma_rotation_deg for step in steps])),
    ):
        if steps:
            words = title, "lines", "standard uncertainty"
            yield ReportChart(*words, lines, values, line=line, caption=caption, log_y=True)
