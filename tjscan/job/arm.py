"""From a job to its arm's kinematics, and to the paths that keep it clear."""

from __future__ import annotations

from dataclasses import replace

from tjscan.core.config import add_file_to_errors
from tjscan.core.frames import Array, inverse_pose
from tjscan.job import CellJob
from tjscan.robot.clearance import ClearPathPlanner
from tjscan.robot.collision import CollisionModel, check_ignored_links
from tjscan.robot.deviations import with_deviations
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.solids import Solid


def kinematics_of_job(job: CellJob) -> Kinematics:
    """Kinematics of the arm's model; ConfigurationError if the model is unknown."""
    with add_file_to_errors(key="arm.model"):
        return Kinematics.load(job.arm.model)


def clear_path_planner_of_job(job: CellJob, deviations: Array | None = None) -> ClearPathPlanner:
    """Planner that keeps a job's arm clear of its surroundings, whichever driver moves it.

    Parameters
    ----------
    job : CellJob
        The job.
    deviations : ndarray, shape (joints, 6), optional
        Of the arm's joints from its model.

    Raises
    ------
    ConfigurationError
        If the arm's model is unknown or its geometry can't be read, or an ignored link is unknown.
    """
    table = job.clearance
    kinematics = kinematics_of_job(job)
    if deviations is not None:
        kinematics = with_deviations(kinematics, deviations)
    with add_file_to_errors(key="clearance.ignore"):
        check_ignored_links(kinematics, table.ignore)
    with add_file_to_errors(key="arm.model"):
        model = CollisionModel(
            kinematics,
            solids_in_base(job),
            [one.solid for one in table.tool],
            self_collision=table.self_collision,
            ignored=table.ignore,
        )
    return ClearPathPlanner(kinematics, model, table)


def solids_in_base(job: CellJob, T_b_w: Array | None = None) -> tuple[Solid, ...]:
    """Solids about a job's arm where they stand in frame b.

    Parameters
    ----------
    job : CellJob
        The job, of one station if it has any.
    T_b_w : ndarray, shape (4, 4), optional
        Where the workpiece's frame stands; as the job states it where left out.
    """
    T_b_w = inverse_pose(job.T_w_b) if T_b_w is None else T_b_w
    return tuple(
        one.solid if one.frame == "b" else replace(one.solid, T=T_b_w @ one.solid.T)
        for one in job.clearance.solid
    )
