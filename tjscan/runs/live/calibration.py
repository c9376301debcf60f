"""What the live page shows of a calibration: while it goes on, and of its recording."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from tjscan.calibration.fits.posed_profile import PosedProfile
from tjscan.calibration.wizard.session import CalibrationProgress
from tjscan.calibration.wizard.topics import (
    CALIBRATION_RECORDING,
    ArmPoseTaken,
    BoardTouch,
    CalibrationEntry,
    LaserLineTaken,
    SkippedPose,
    StartOrResumeEntry,
    read_calibration_entries,
)
from tjscan.core.frames import Array, rot_z, transform_points
from tjscan.job import CalibrationJob, read_calibration_job
from tjscan.job.arm import kinematics_of_job, sensor_mount_of_job, solids_in_base
from tjscan.laser.profile import Profile
from tjscan.live.colours import FITTED, GHOST, LASER, TOOL
from tjscan.live.drawables import Drawable, Lines, Posture, Surface
from tjscan.live.step import Measure, PlaneCurve, RecordedShow, Sample, Setting, Step
from tjscan.recording.parts import recording_files
from tjscan.result.directory import JOB
from tjscan.runs.calibration.run import calibration_plan_of_job

POSITION: Final = Measure("position known to", "mm", logarithmic=True)
ROTATION: Final = Measure("rotation known to", "°", logarithmic=True)
HEAD: Final = ("line", "offset / mm", "residual / σ", "")
"""Of the list of lines."""

CROSS: Final = 0.015
"""Metres, half the size of the mark on a touched place."""

CalibrationNews = CalibrationEntry | CalibrationProgress


class CalibrationShow:
    """Turns what a calibration measures into steps of the page.

    Parameters
    ----------
    job : CalibrationJob
    job_file : Path
        Where it was read from.
    title : str
        Of the run.
    """

    def __init__(self, job: CalibrationJob, job_file: Path, title: str) -> None:
        self._job, self._title = job, title
        self._plan = calibration_plan_of_job(job, sensor_mount_of_job(job, job_file).T_f_s)
        self._T_f_s = self._plan.T_f_s
        self.setting = self._setting()

    def step(self, news: CalibrationNews) -> Step:
        """Return what an entry of the logbook, or the progress after a line, changes."""
        match news:
            case StartOrResumeEntry():
                return Step("begun", facts={"lines": f"0 of {self._plan.lines}"})
            case BoardTouch():
                return self._touch_step(news)
            case LaserLineTaken():
                what = "verification" if news.for_verification else news.posed_profile.name
                return self._profile_step(what, news.posed_profile)
            case ArmPoseTaken():
                return self._profile_step(news.posed_profile.name, news.posed_profile, news.q)
            case SkippedPose():
                return Step("skipped", events=(("passed over", news.reason),))
            case CalibrationProgress():
                return self._progress_step(news)

    def next_pose(self, T_b_f: Array | None) -> Step:
        """Draw where the next move leads: the flange's axes, and the laser's plane from there."""
        if T_b_f is None:
            return Step(drawn={"next": Lines(np.empty((0, 2, 3)), FITTED)})
        T_b_s, window = T_b_f @ self._T_f_s, self._plan.window
        reach = window.far * np.tan(window.half_angle)
        corners = transform_points(T_b_s, [(-reach, 0, window.far), (reach, 0, window.far)])
        fan = np.vstack((T_b_s[:3, 3], corners, T_b_s[:3, 3]))
        axes = [np.stack((T_b_f[:3, 3], T_b_f[:3, 3] + 0.1 * axis)) for axis in T_b_f[:3, :3].T]
        way = np.stack((T_b_f[:3, 3], T_b_s[:3, 3]))
        return Step(drawn={"next": Lines.through(fan, way, *axes, colour=FITTED, width=3.0)})

    def _setting(self) -> Setting:
        job, board = self._job, self._plan.T_b_board
        at = 0.6 * board[:3, 3] + (0.0, 0.0, 0.2)
        out = 3.2 * max(float(np.linalg.norm(at[:2])), 0.4)
        towards = at[:2] / max(float(np.linalg.norm(at[:2])), 1e-6)
        aside = rot_z(np.radians(-65)) @ np.array((*towards, 0.0))
        return Setting(
            self._title,
            (POSITION, ROTATION),
            "lines taken",
            None,
            kinematics_of_job(job),
            solids_in_base(job),
            tuple(one.solid for one in job.clearance.tool),
            ghost=(self._board(),),
            look_at=at,
            look_from=at + out * aside + (0.0, 0.0, 0.6 * out),
        )

    def _board(self) -> Surface:
        x, y = self._plan.half_sizes
        corners = [(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)]
        face = transform_points(self._plan.T_b_board, corners)
        return Surface(face, np.array([(0, 1, 2), (0, 2, 3)]), GHOST, 0.6)

    def _touch_step(self, touch: BoardTouch) -> Step:
        label, drawn = f"place {touch.place_number + 1}", dict[str, Drawable]()
        if touch.T_b_f is None:
            return Step(label, events=(("passed over", label),))
        tip = transform_points(touch.T_b_f, self._plan.tip_f)
        marks = [np.stack((tip - arm, tip + arm)) for arm in CROSS * np.eye(3)]
        drawn[f"touch/{touch.place_number}"] = Lines.through(*marks, colour=TOOL, width=3.0)
        if touch.q is not None:
            drawn["arm"] = Posture(touch.q)
        return Step(label, drawn, {"touched": f"{label} of {self._plan.touches}"})

    def _profile_step(self, label: str, shot: PosedProfile, q: Array | None = None) -> Step:
        points = shot.profile.points_s
        points = points[np.isfinite(points).all(axis=1)]
        posture = shot.q if q is None else q
        drawn: dict[str, Drawable] = {} if posture is None else {"arm": Posture(posture)}
        if len(points) > 1:
            seen = transform_points(shot.T_b_f @ self._T_f_s, points[:: max(1, len(points) // 48)])
            drawn[f"line/{label}"] = Lines.through(seen, colour=LASER, width=2.5)
        return Step(label, drawn, {"taken": label}, profile=plane_curve(shot.profile))

    def _progress_step(self, progress: CalibrationProgress) -> Step:
        """How sure the pose is after each line; the lines in the table, and where they belong."""
        sure, taken = progress.uncertainty, len(progress.samples)
        values = {
            POSITION.name: 1e3 * sure.position,
            ROTATION.name: float(np.degrees(sure.rotation)),
        }
        facts = {
            "lines": f"{taken} of {progress.wanted}",
            "certain to": f"{values[POSITION.name]:.3g} mm, {values[ROTATION.name]:.3g}°"
            + ("" if progress.result else " expected"),
        }
        rows = [HEAD]
        if (result := progress.result) is not None:
            self._T_f_s = result.T_f_s
            rows += [
                (
                    one.name,
                    f"{1e3 * one.offset:+.3f}",
                    f"{one.misfit:.1f}",
                    "" if one.used else "left out",
                )
                for one in result.residuals
            ]
        else:
            rows += [(sample.name, "", "", "") for sample in progress.samples]
        return Step(
            f"{taken} lines",
            facts=facts,
            progress=min(taken / progress.wanted, 1.0),
            samples=(Sample(float(taken), values),),
            table=rows,
        )


def plane_curve(profile: Profile) -> PlaneCurve:
    """A profile as the page plots it."""
    points = 1e3 * profile.points_s
    return PlaneCurve(points[:, 0], points[:, 2])


def read_calibration_show(directory: Path) -> RecordedShow | None:
    """Read what a calibration's recording has to show; see `tjscan.live.step.ShowReader`."""
    if not recording_files(directory, CALIBRATION_RECORDING)[0].is_file():
        return None
    job_file = directory / JOB
    show = CalibrationShow(read_calibration_job(job_file), job_file, directory.resolve().name)
    return RecordedShow(show.setting, tuple(map(show.step, read_calibration_entries(directory))))
