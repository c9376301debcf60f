"""Both truths of a vehicle, driven over a distance."""

from math import hypot, pi

import numpy as np

from tjscan.core.frames import Array
from tjscan.vehicle.pad_plant import PadPlant, PadSettings
from tjscan.vehicle.slip_plant import SlipPlant, SlipSettings
from tjscan.vehicle.tracks import TrackGeometry, VehiclePlant

TRACKS = TrackGeometry()
LEVEL_START = np.zeros(3)
STEP = 0.1
"""Seconds."""


def slip_plant(start: Array = LEVEL_START, **settings: float) -> SlipPlant:
    return SlipPlant(SlipSettings(**settings), TRACKS.gauge, start)


def pad_plant(friction: float = 0.5, down: float = pi / 2, inclination: float = pi / 2) -> PadPlant:
    settings = PadSettings(friction=friction, down=down, inclination=inclination)
    return PadPlant(settings, TRACKS, LEVEL_START)


def drive(
    plant: VehiclePlant, distance: float, curvature: float = 0.0, speed: float = 0.02
) -> Array:
    """Drive a signed distance along a curvature, as the tracks have it; the poses, shape (n, 3)."""
    u = speed if distance > 0 else -speed
    half = TRACKS.gauge * curvature * u / 2
    poses = [plant.pose_w]
    for _ in range(round(abs(distance) / speed / STEP)):
        plant.advance(u + half, u - half, STEP)
        poses.append(plant.pose_w)
    return np.array(poses)


def path_figures(poses_w: Array) -> tuple[float, float, float]:
    """Mean forward speed, crab (sideways over forward) and turn a metre, in frame v."""
    steps = np.diff(poses_w, axis=0)
    heading = (poses_w[1:, 2] + poses_w[:-1, 2]) / 2
    forward = np.cos(heading) * steps[:, 0] + np.sin(heading) * steps[:, 1]
    sideways = -np.sin(heading) * steps[:, 0] + np.cos(heading) * steps[:, 1]
    along = float(forward.sum())
    return (
        along / len(steps) / STEP,
        float(sideways.sum()) / abs(along),
        float(steps[:, 2].sum()) / along,
    )


def distance_between(a: Array, b: Array) -> float:
    """Metres between two poses on the surface."""
    return hypot(*(a - b)[:2])
