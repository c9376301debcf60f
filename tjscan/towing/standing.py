"""Vehicles that stand though they should drive, and how far the weld goes on beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from tjscan.core.errors import VehicleFault, VehicleLinkLost
from tjscan.core.frames import Array
from tjscan.towing.following import velocity_from_twist
from tjscan.towing.shape.cable import Cable, TowingTeam
from tjscan.towing.shape.plan import TowingPlan
from tjscan.towing.standstill import StandstillCheck
from tjscan.towing.team_poses import TeamEstimate
from tjscan.towing.waiting import Waiting
from tjscan.vehicle.vehicle import Twist, VehicleState

TAUT: Final = 0.98
"""Chord of a piece of cable beside a vehicle that stands, as share of its length, at which the
welder waits."""

SLACK: Final = 0.95
"""The same from which on it goes slower, and below which it goes on after it waited: what noise of
the poses changes is less than the way between the two."""

BENT: Final = 0.9
"""Share of the joints' limit to which the cable beside a vehicle that stands may be planned to bend
before the welder waits: pulled from its other end, it bends more than planned at the vehicle."""

EASED: Final = 0.85
"""The same below which the welder goes on after it waited."""

LEAST_PACE: Final = 0.1
"""Share of its speed with which it goes on until it waits: ever slower, it would never arrive."""


class StandingVehicles:
    """Notices vehicles that stand, and what that means for the weld.

    Parameters
    ----------
    cable : Cable
    team : TowingTeam
    report : callable
        Receives events: a name and a sentence.

    Attributes
    ----------
    stopped : tuple of int
        Those that stand for good.
    """

    def __init__(self, cable: Cable, team: TowingTeam, report: Callable[[str, str], None]) -> None:
        self._cable, self._team, self._report = cable, team, report
        self._checks = [StandstillCheck() for _ in team.held_links]
        self._states: Sequence[VehicleState | VehicleFault] = ()
        self._doubted: tuple[int, ...] = ()  # those that stand, and those not seen to drive since
        self._taut = self._bent = False
        self.stopped: tuple[int, ...] = ()

    def update(
        self,
        now: float,
        period: float,
        states: Sequence[VehicleState | VehicleFault],
        asked: Sequence[Twist],
        estimate: TeamEstimate,
    ) -> None:
        """Take in what the vehicles did in a period with the twists that they were asked for."""
        stopped, doubted = [], []
        for v, (state, check) in enumerate(zip(states, self._checks, strict=True)):
            fault = isinstance(state, VehicleFault) or bool(state.fault)
            pose = estimate.poses[v]
            way = period * velocity_from_twist(asked[v], pose[2])[:2]
            if check.update(now, pose, way, sigma=estimate.sigmas[v, 0], fault=fault):
                stopped.append(v)
                if v not in self._doubted and not isinstance(state, VehicleLinkLost):
                    why = _fault_of(state) or "it is told to drive, and does not move"
                    self._report("stands", f"vehicle {v + 1}: {why}")
            if check.doubted:
                doubted.append(v)
        for v in sorted(set(self._doubted) - set(doubted)):
            self._report("drives again", f"vehicle {v + 1}")
        self._states, self.stopped, self._doubted = states, tuple(stopped), tuple(doubted)

    def reason_to_wait(self, poses: Array, last: TowingPlan | None) -> Waiting | None:
        """Why the welder must wait for those that stand.

        Parameters
        ----------
        poses : ndarray, shape (vehicles, 3)
            As believed.
        last : TowingPlan or None
            That was sent last.
        """
        welder = self._team.welder
        if welder in self.stopped:
            why = _fault_of(self._states[welder]) or "it does not move"
            return Waiting(f"the welder stands: {why}", device=True)
        share, standing = self._tautest(poses)
        self._taut = share >= (SLACK if self._taut else TAUT)
        if self._taut:
            return Waiting(
                f"vehicle {standing + 1} stands, and the cable beside it is taut", device=True
            )
        share, standing = (0.0, 0) if last is None else self._most_bent(last)
        self._bent = share >= (EASED if self._bent else BENT)
        if self._bent:
            return Waiting(
                f"vehicle {standing + 1} stands, and the cable beside it nears its limit of bend",
                device=True,
            )
        return None

    def pace(self, poses: Array) -> float:
        """Share of the welding speed that the pieces of cable beside them allow."""
        share, _ = self._tautest(poses)
        return float(np.clip((TAUT - share) / (TAUT - SLACK), LEAST_PACE, 1.0))

    def _tautest(self, poses: Array) -> tuple[float, int]:
        """Largest chord of a piece beside a standing vehicle, over its length, and which one."""
        held = np.array(self._team.held_links)
        lengths = self._cable.link_length * np.diff(held, prepend=-1)
        steps = np.diff(np.vstack((self._cable.root[:2], poses[:, :2])), axis=0)
        shares = np.hypot(steps[:, 0], steps[:, 1]) / lengths
        beside = [(float(shares[k]), v) for v in self._doubted for k in (v, v + 1) if k < len(held)]
        return max(beside, default=(0.0, 0))

    def _most_bent(self, last: TowingPlan) -> tuple[float, int]:
        """Largest joint angle beside a standing vehicle, over its limit, and which one.

        As planned or as estimated, whichever is larger.
        """
        ends = (0, *(link + 1 for link in self._team.held_links))
        angles = np.maximum(np.abs(last.angles), np.abs(last.estimate)) / self._cable.joint_limit
        return max(
            (
                (float(angles[ends[v] : ends[min(v + 2, len(ends) - 1)]].max()), v)
                for v in self._doubted
            ),
            default=(0.0, 0),
        )


def _fault_of(state: VehicleState | VehicleFault) -> str:
    return state.fault if isinstance(state, VehicleState) else str(state)
