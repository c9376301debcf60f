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
from tjscan.calibration.noise import NoiseModel
from tjscan.core.devices import DriverKind
from tjscan.core.errors import ConfigurationError
from tjscan.core.manifest import check_as_written
from tjscan.job import read_calibration_job
from tjscan.result.chapter import ReportChapter, ReportChart, ReportSheet
from tjscan.result.directory import CALIBRATION_FILE, CALIBRATION_PICTURE, JOB_FILE
from tjscan.runs.scan.results import calibration_label


def calibration_chapter(directory: Path) -> ReportChapter:
    """Make the calibration's chapter of a report; see `tjscan.result.chapter.ChapterWriter`."""
    file = directory / CALIBRATION_FILE
    if not file.is_file():
        return ReportChapter(
            facts=(("calibration", "stated in the job; its uncertainty is not known"),),
            findings=(
                "The sensor's pose on the flange is stated in the job and was not calibrated with "
                "this program: its error is in every point, and is not known.",
            ),
        )
    found = read_calibration(file)
    return ReportChapter(
        facts=(
            (
                "calibration",
                f"{calibration_label(directory)}, {found.lines} lines: the sensor's pose on the "
                f"flange is known to {found.sigma_position_mm:.3f} mm and "
                f"{found.sigma_rotation_deg:.4f}° (one standard deviation)",
            ),
        )
    )


MOST_NAMED: Final = 4
"""Profiles left out that the page names; the file names all."""

USE_LABELS: Final = {True: "in use", False: "left out"}


def calibration_page(directory: Path) -> ReportChapter:
    """Make the page of a calibration's directory; see `tjscan.result.chapter.ChapterWriter`."""
    file = directory / CALIBRATION_FILE
    if not file.is_file():
        raise ConfigurationError(
            "holds a calibration that is not finished; go on with it: "
            f"tjscan calibrate --resume {directory}",
            file=directory,
        )
    check_as_written(directory / JOB_FILE, file)
    found = read_calibration(file)
    fixed = found.T_b_s_mm is not None
    return ReportChapter(
        facts=tuple(_facts(found)),
        findings=tuple(_findings(directory, found)),
        charts=tuple(_charts(found)),
        sheet=ReportSheet(
            "Calibration", tuple(_headline(found)), CALIBRATION_PICTURE, "b" if fixed else "f"
        ),
    )


def _headline(found: CalibrationFile) -> Iterator[tuple[str, str]]:
    """The sensor's pose, each number with its standard uncertainty."""
    sigma = np.sqrt(np.diag(found.covariance))
    rows = np.array(found.sensor_rows)
    turn = Rotation.from_matrix(rows[:3, :3]).as_rotvec(degrees=True)
    where = "on the flange" if found.T_b_s_mm is None else "in the arm's base"
    for axis, value, spread in zip("xyz", rows[:3, 3], sigma[:3], strict=True):
        yield f"{axis} of the sensor {where}", f"{value:.3f} ± {spread:.3f} mm"
    for axis, value, spread in zip("xyz", turn, sigma[3:], strict=True):
        yield f"rotation vector, {axis}", f"{value:.4f} ± {spread:.4f}°"
    yield (
        "standard uncertainty, all axes together",
        f"{found.sigma_position_mm:.3f} mm, {found.sigma_rotation_deg:.4f}°",
    )
    if found.kinematics is not None:
        arm = found.kinematics
        yield (
            f"{arm.held_out_poses} poses held out, the arm as stated → as calibrated",
            f"{arm.held_out_before_mm:.3f} → {arm.held_out_after_mm:.3f} mm RMS",
        )


def _facts(found: CalibrationFile) -> Iterator[tuple[str, str]]:
    basis = found.basis
    yield "devices", f"arm {found.arm}, laser {found.laser}, {found.date:%Y-%m-%d %H:%M} UTC"
    target = "" if basis is None else basis.target
    yield "target", f"{target or 'not kept by the version that wrote the file'}; {found.method}"
    yield (
        "profiles",
        f"{found.lines} in use; left out: {len(found.residuals) - found.lines} as contradicting "
        f"the others, {0 if basis is None else len(basis.left_out)} before that",
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
    if basis is not None:
        yield "poses read as", "; ".join(basis.poses_read_as)
    used = [residual for residual in found.residuals if residual.used]
    offsets = np.array([residual.offset_mm for residual in used])
    worst = used[int(np.argmax(np.abs(offsets)))]
    yield (
        "residuals in use",
        f"{np.sqrt(np.mean(offsets**2)):.3f} mm RMS, largest {worst.offset_mm:+.3f} mm "
        f"({worst.name})",
    )
    if (fresh := found.verification) is not None:
        yield (
            "a fresh line",
            f"{fresh.offset_mm:+.3f} mm and {fresh.tilt_deg:+.4f}° off; {fresh.misfit:.1f} "
            f"standard deviations, {fresh.limit:.1f} may be",
        )
    yield "errors stated", _noise(found.noise, found.geometry_mm)
    if found.kinematics is not None:
        yield "arm", _arm(found.kinematics)


def _noise(noise: NoiseModel, geometry_mm: float) -> str:
    return (
        f"range {1e3 * noise.range:g} mm, pose {1e3 * noise.position:g} mm and "
        f"{np.degrees(noise.rotation):.3g}° each axis, touch {1e3 * noise.touch:g} mm; the arm's "
        f"geometry is allowed {geometry_mm:.2g} mm"
    )


def _arm(arm: ArmKinematicsEntry) -> str:
    left = arm.left_as_stated
    return (
        f"{arm.model}: six deviations of each of {len(arm.deviations)} joints; left as the maker "
        "states: "
        + ("; ".join(line.removesuffix(": left as the maker states") for line in left) or "none")
    )


def _findings(directory: Path, found: CalibrationFile) -> Iterator[str]:
    if (file := directory / JOB_FILE).is_file():
        job = read_calibration_job(file)
        if {job.arm.driver_kind, job.laser.driver_kind} == {DriverKind.SIMULATED}:
            yield "Simulated: no real arm or laser measured this."
    if found.T_b_s_mm is not None:
        yield "The sensor is fixed in the room: this is its pose in the arm's base."
    basis = found.basis or BasisEntry(target="")
    for line in basis.caveats:
        yield f"{line[:1].upper()}{line[1:]}."
    for line in basis.left_out[:MOST_NAMED]:
        yield f"{line[:1].upper()}{line[1:]}."
    if (more := len(basis.left_out) - MOST_NAMED) > 0:
        yield f"{more} more were left out; {CALIBRATION_FILE} names them."


def _charts(found: CalibrationFile) -> Iterator[ReportChart]:
    used = np.array([residual.used for residual in found.residuals])
    misfit = np.array([residual.misfit for residual in found.residuals])
    numbers = np.arange(1, len(used) + 1)
    for which, line in ((used, USE_LABELS[True]), (~used, USE_LABELS[False])):
        if which.any():
            yield ReportChart(
                "residual of each profile",
                "profile, in their order",
                "residual / standard deviations",
                numbers[which],
                misfit[which],
                nominal=1.0 if line == USE_LABELS[True] else None,
                line=line,
                caption="Offset and tilt together, against what the noise stated lets one expect: "
                "dashed.",
                mark="bar",
            )
    yield from _view_charts(found)
    yield from _shrinking_charts(found)


def _view_charts(found: CalibrationFile) -> Iterator[ReportChart]:
    used = {residual.name: residual.used for residual in found.residuals}
    views = () if found.basis is None else found.basis.views
    frame = "the arm's base" if found.T_b_s_mm is None else "the flange"
    # An arm's calibration solves with some of its profiles, and is checked by the others.
    other = "left out" if found.kinematics is None else "others"
    lines = [other if view.name not in used else USE_LABELS[used[view.name]] for view in views]
    for line in dict.fromkeys((USE_LABELS[True], *lines)):
        shown = [view for view, own in zip(views, lines, strict=True) if own == line]
        if shown:
            tilt = np.array([view.tilt_deg for view in shown])
            azimuth = np.radians([view.azimuth_deg for view in shown])
            yield ReportChart(
                "how the sensor was tilted",
                "towards x / °",
                "towards y / °",
                tilt * np.cos(azimuth),
                tilt * np.sin(azimuth),
                line=line,
                caption="A dot for each profile: its distance from the origin is the tilt from z "
                f"of {frame}, its direction the azimuth.",
                plane=True,
                mark="dot",
            )


def _shrinking_charts(found: CalibrationFile) -> Iterator[ReportChart]:
    steps = () if found.basis is None else found.basis.shrinking
    for line, values in (
        ("position / mm", [step.sigma_position_mm for step in steps]),
        ("rotation / °", [step.sigma_rotation_deg for step in steps]),
    ):
        if steps:
            yield ReportChart(
                "uncertainty over the number of lines",
                "lines",
                "standard uncertainty",
                np.array([step.lines for step in steps]),
                np.array(values),
                line=line,
                caption="Of the result, after each line.",
                log_y=True,
            )
