"""Where all vehicles are, and which measured poses can't be true for the cable between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np

from tjscan.core.frames import Array
from tjscan.towing.pose_filter import OUTLIER_SIGMAS, PoseEstimate, VehiclePoseFilter
from tjscan.towing.shape.cable import Cable, TowingTeam
from tjscan.towing.tables import LocalisationSettings
from tjscan.vehicle.localisation import VehiclePose
from tjscan.vehicle.vehicle import Twist


@dataclass(frozen=True, slots=True, eq=False)
class TeamEstimate:
    """Where the vehicles are believed to be.

    Parameters
    ----------
    estimates : tuple of PoseEstimate
        One each.
    """

    estimates: tuple[PoseEstimate, ...]

    @property
    def poses(self) -> Array:
        """x, y, heading of each, shape (vehicles, 3)."""
        return np.array([one.pose for one in self.estimates])

    @property
    def sigmas(self) -> Array:
        """Standard deviations of position and heading, shape (vehicles, 2)."""
        return np.array([(one.position_sigma, one.heading_sigma) for one in self.estimates])


class TeamPoses:
    """Filters of the vehicles' poses, one each, and a check of those that jumped.

    A vehicle may be pushed farther than it drives, and a measurement may jump, or take one
    vehicle for another. Where poses were refused for as long as `LocalisationSettings.lost`, they
    are taken after all if the cable reaches from one vehicle to the next, and no two bodies
    overlap; else the vehicle counts as lost.

    Parameters
    ----------
    cable : Cable
    team : TowingTeam
    settings : LocalisationSettings
    report : callable
        Receives events: a name and a sentence.
    """

    def __init__(
        self,
        cable: Cable,
        team: TowingTeam,
        settings: LocalisationSettings,
        report: Callable[[str, str], None],
    ) -> None:
        self._cable, self._team, self._settings, self._report = cable, team, settings, report
        self._filters = tuple(
            VehiclePoseFilter(
                settings.position_sigma,
                settings.heading_sigma,
                top_speed=team.top_speed,
                top_turn_rate=team.top_speed / team.body_radius,
                longest_gap=settings.lost,
            )
            for _ in team.held_links
        )
        self._refused = [""] * len(self._filters)

    @property
    def unknown(self) -> tuple[int, ...]:
        """Vehicles of which no pose came yet."""
        return tuple(v for v, one in enumerate(self._filters) if not one.known)

    def update(
        self,
        time: float,
        period: float,
        odometry: Sequence[Twist],
        measured: Sequence[VehiclePose | None],
    ) -> TeamEstimate:
        """Go on to a time with what was measured since the last update."""
        found = [
            one.update(time, period, twist, pose)
            for one, twist, pose in zip(self._filters, odometry, measured, strict=True)
        ]
        late = [v for v, one in enumerate(found) if one.age > self._settings.lost]
        if late and self._take_denied(time, late, found):
            found = [one.estimate(time) for one in self._filters]
        self._report_changes(found)
        return TeamEstimate(tuple(found))

    def lost(self, estimate: TeamEstimate) -> dict[int, str]:
        """Vehicles whose poses are lost, and why in a word or two."""
        return {
            v: one.refused or "none comes"
            for v, one in enumerate(estimate.estimates)
            if one.age > self._settings.lost
        }

    def _take_denied(self, time: float, late: Sequence[int], found: list[PoseEstimate]) -> bool:
        denied = {v: self._filters[v].denied for v in late}
        poses = np.array([one.pose for one in found])
        for v, pose in denied.items():
            if pose is not None:
                poses[v] = pose
        if not any(pose is not None for pose in denied.values()) or not self._can_be(poses):
            return False
        for v, pose in denied.items():
            if pose is not None:
                way = hypot(*(pose - found[v].pose)[:2])
                self._filters[v].begin_at(pose, time)
                self._report(
                    "moved", f"vehicle {v + 1} was moved by {1e3 * way:.0f} mm, and not by itself"
                )
        return True

    def _can_be(self, poses: Array) -> bool:
        """Whether the cable reaches from each vehicle to the next, and no bodies overlap."""
        doubt = OUTLIER_SIGMAS * self._settings.position_sigma
        places = np.vstack((self._cable.root[:2], poses[:, :2]))
        lengths = self._cable.link_length * np.diff(self._team.held_links, prepend=-1)
        steps = np.diff(places, axis=0)
        if (np.hypot(steps[:, 0], steps[:, 1]) > lengths + doubt).any():
            return False
        apart = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=-1)
        np.fill_diagonal(apart, np.inf)
        return bool(apart.min() > 2 * self._team.body_radius - doubt)

    def _report_changes(self, found: Sequence[PoseEstimate]) -> None:
        for v, one in enumerate(found):
            if not self._filters[v].known:
                continue
            if one.refused and not self._refused[v]:
                self._report("no pose", f"of vehicle {v + 1}: {one.refused}")
            elif self._refused[v] and not one.refused:
                self._report("pose again", f"of vehicle {v + 1}")
            self._refused[v] = one.refused
