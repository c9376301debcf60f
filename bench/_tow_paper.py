"""The paper's experiments as printed, and what cable it is, on the plant of another make."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from _other_cable import CableTruth
from _table import Row
from _tow_disturbances import DisturbedTow, tow_disturbed
from _tows import EXAMPLES, seam_piece

from tjscan.core.frames import Array
from tjscan.job.tow.job import read_tow_job
from tjscan.runs.tow.results import clearance_from_discs
from tjscan.towing.identification import identify_cable
from tjscan.towing.shape.plan import PoseAccuracy

TABLE_III: Final = {
    "vehicles.radius_mm": 200,
    "vehicles.force_n": 20.6,
    "simulation.towing_vehicle.mass_kg": 4.2,
}
"""Keys of the paper's real vehicles: 4.2 kg, whose wheels grip with half of their weight."""

GRIP: Final = 20.6
VA_SEAM, VA_PIECE = 9.6, 1.0
"""Metres of V-A's seam, and of its beginning, which ``--quick`` tows."""

VA_AREA: Final = [[-1000, -5000], [4000, -5000], [4000, 5000], [-1000, 5000]]
"""The paper does not tell V-A's area: in V-C's, 6 m of cable find no room beside the root."""

CABLES: Final = (CableTruth(1.5, 0.7, 0.3), CableTruth(0.7, 1.3, -0.5), CableTruth(2.5, 1.0, 0.2))
"""Other cables on other floors than the job states."""

PUSH_NOISE: Final = 1.0
"""Newton, and a tenth of it in N m: of the pushes that drives report."""

PRINTED_PASSER_BY: Final = {
    "name": "passer-by",
    "points_mm": [[340, -2900], [3400, -2800]],
    "speed_mm_min": 600,
    "radius_mm": 200,
}


def tow_quietly(
    example: str, keys: dict[str, Any], seed: int, truth: CableTruth | None = None
) -> DisturbedTow:
    """Tow a job in a sound world."""
    job = read_tow_job(EXAMPLES / f"{example}.toml", {**keys, "simulation.seed": seed})
    return tow_disturbed(job, lambda world, seen: None, truth)


def joint_errors(tow: DisturbedTow) -> tuple[Array, Array, Array]:
    """Errors of the estimated joint angles, degrees, and estimated and true places of the links."""
    chain, truths = tow.job.chain, tow.journal.truths
    lines = np.array([truth.line for truth in truths])
    steps = np.diff(lines, axis=1)
    headings = np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=1)
    angles = np.diff(headings, axis=1, prepend=chain.root[2])
    angles = (angles + np.pi) % (2 * np.pi) - np.pi
    estimates = np.array([cycle.plan.estimate for cycle in tow.journal.cycles])
    places = np.array([chain.poses(one)[:, :2] for one in estimates])
    return np.degrees(np.abs(estimates - angles)), places, lines[:, 1:]


def estimate_rows(seed: int, length: float) -> list[Row]:
    """V-A on metres of its seam: lower 99 % and upper 1 % of errors, R² of the links' places."""
    seam = {"seam.points_mm": [[1400, -4800], [1400, -4800 + 1e3 * length]]}
    keys = {**seam, "area.outline_mm": VA_AREA}
    tow = tow_quietly("tow-simulation", keys, seed, CableTruth(1.3, 0.8, 0.3))
    errors, places, truths = joint_errors(tow)
    split = np.percentile(errors, 99)
    left = ((places - truths) ** 2).sum() / ((truths - truths.mean(axis=(0, 1))) ** 2).sum()
    name = "V-A, cable unlike the job's: estimate of a joint"
    return [
        Row("V-A: complete", 100.0 * (not tow.ended), np.inf, "%", at_least=100),
        Row(f"{name}, mean (the paper: within 6)", float(errors.mean()), 6, "°"),
        Row(f"{name}, mean of the lower 99 %", float(np.mean(errors[errors <= split])), 6, "°"),
        Row(f"{name}, mean of the upper 1 %", float(errors[errors > split].mean()), np.inf, "°"),
        Row("V-A: R² of the links' places", float(1 - left), np.inf, at_least=0.997),
    ]


def table_three_rows(tows: list[DisturbedTow]) -> list[Row]:
    """V-D with the paper's own vehicles: force on the welder, tension, grip."""
    force = np.concatenate(
        [[np.hypot(*t.welder_force[:2]) for t in tow.journal.truths] for tow in tows]
    )
    grip = max(t.vehicle_forces.max() for tow in tows for t in tow.journal.truths)
    mean = max(np.hypot(*c.forces.T).max() for tow in tows for c in tow.journal.cycles)
    tension = max(cycle.tension for tow in tows for cycle in tow.journal.cycles)
    name = "V-D, table III"
    return [
        Row(
            f"{name}: complete",
            100 * float(np.mean([not tow.ended for tow in tows])),
            np.inf,
            "%",
            at_least=100,
        ),
        Row(f"{name}: force on the welder, mean", float(force.mean()), 6, "N"),
        Row(f"{name}: force on the welder, max", float(force.max()), np.inf, "N"),
        Row(f"{name}: tension of the cable as estimated, max", float(tension), np.inf, "N"),
        Row(f"{name}: grip used, largest in 5 ms", float(100 * grip / GRIP), 80, "%"),
        Row(f"{name}: grip used, largest mean of 4 s", float(100 * mean / GRIP), 80, "%"),
    ]


def printed_passer_by_rows(seed: int) -> list[Row]:
    """V-E on the printed path, and how near to it any shape of the cable can come.

    What is farther from the path than it can reach tests nothing: distances of a point of the cable
    from root and welder add up to its length at most.
    """
    keys = {"obstacles": [PRINTED_PASSER_BY], "vehicles.behind_welder_mm": 600, "seam.stand_s": 330}
    tow = tow_quietly("tow-passer-by", keys, seed)
    job, truths = tow.job, tow.journal.truths
    begin, end = np.array(job.obstacles[0].points)
    path = begin + np.linspace(0, 1, 500)[:, None] * (end - begin)
    ends = np.array((job.root.position, job.seam.points[0]))
    beyond = np.linalg.norm(path[:, None] - ends, axis=-1).sum(axis=1) - job.cable.length
    near = min(clearance_from_discs(truth.line, truth.passers_by) for truth in truths)
    force = np.array([np.hypot(*truth.welder_force[:2]) for truth in truths])
    name = "V-E, printed path"
    return [
        Row(f"{name}: complete", 100.0 * (not tow.ended), np.inf, "%", at_least=100),
        Row(f"{name}: no cable reaches nearer", 1e3 * (beyond.min() / 2 - 0.2), np.inf, "mm"),
        Row(f"{name}: cable to the passer-by", 1e3 * near, np.inf, "mm", at_least=12),
        Row(f"{name}: touches", sum(len(truth.touches) for truth in truths), 0),
        Row(f"{name}: force on the welder, mean", float(force.mean()), 6, "N"),
        Row(f"{name}: force on the welder, max", float(force.max()), 12, "N"),
    ]


def identification_rows(seed: int) -> list[Row]:
    """What 900 mm of a tow show of the cable, and the estimate with that elsewhere."""
    rows, rng, off = [], np.random.default_rng(seed), []
    for truth in CABLES:
        tow = tow_quietly("tow-simulation", seam_piece("tow-simulation", 0.3, 0.9), seed, truth)
        job, cycles = tow.job, tow.journal.cycles
        pushes = np.array([cycle.pushes for cycle in cycles])
        pushes += PUSH_NOISE * rng.normal(size=pushes.shape) * (1, 1, 0.1)
        trust = PoseAccuracy(job.localisation.position_sigma, job.localisation.heading_sigma)
        poses = np.array([cycle.poses for cycle in cycles])
        found = identify_cable(
            job.chain, job.held_links, poses, pushes, cycles[0].plan.estimate, trust
        )
        stiff, drag = truth.stiffness * 0.17, truth.friction * job.chain.friction / job.cable.link
        off += [
            (found.stiffness - stiff) / found.stiffness_sd,
            (found.drag - drag) / found.drag_sd,
            (found.curvature - truth.curvature) / found.curvature_sd,
        ]
        name = f"cable {truth.stiffness:g}, {truth.friction:g}, {truth.curvature:g}/m"
        keys = seam_piece("tow-simulation", 0.7, 0.3)
        before = tow_quietly("tow-simulation", keys, seed + 1, truth)
        keys["identified"] = {
            "stiffness_n_m2": found.stiffness,
            "stiffness_sd_n_m2": found.stiffness_sd,
            "drag_n_m": found.drag,
            "drag_sd_n_m": found.drag_sd,
            "curvature_deg_m": float(np.degrees(found.curvature)),
            "curvature_sd_deg_m": float(np.degrees(found.curvature_sd)),
        }
        after = tow_quietly("tow-simulation", keys, seed + 1, truth)
        rows += [
            Row(f"{name}: stiffness, error", 100 * abs(found.stiffness / stiff - 1), 10, "%"),
            Row(f"{name}: drag, error", 100 * abs(found.drag / drag - 1), 10, "%"),
            Row(f"{name}: set, error", abs(found.curvature - truth.curvature), 0.1, "1/m"),
        ]
        for words, one in (("as the job states", before), ("identified", after)):
            errors, places, truths = joint_errors(one)
            limits = (1.2, 7.0) if one is after else (np.inf, np.inf)
            link = 1e3 * float(np.linalg.norm(places - truths, axis=-1).mean())
            rows += [
                Row(f"{name}, {words}: estimate of a joint", float(errors.mean()), limits[0], "°"),
                Row(f"{name}, {words}: estimate of a link", link, limits[1], "mm"),
            ]
    rows.append(
        Row(
            "cables: errors over their standard deviations, rms",
            float(np.sqrt(np.mean(np.square(off)))),
            np.inf,
        )
    )
    return rows
