"""The path of a station's torch as a program in URScript: poses, speeds, and the output of the arc.

`docs/ur.md` lists the functions that it uses. No arm has run such a file. A real controller lets no
two blends overlap (its manual), keeps to the speed through a blend with ``movep`` alone, and stops
with an error if the tool turns back in one: blends here are a fifth of the shorter step beside
them, and there are none where chords meet at more than 10 degrees, as at the ends of a weave's
swings. No output sets the wire feed: with an arc, a bead whose feed varies has no program, and
before the first bead and between two of other feeds the program waits for an operator.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy  # its parts are loaded at first use

from tjscan.core.bead_segments import weave_corners, weave_swing
from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array
from tjscan.core.pose_vector import pose_to_vector
from tjscan.core.units import M_PER_MIN
from tjscan.planning.lay import PlannedBead
from tjscan.planning.wps import WeaveSettings, WeldingProcedure

BLEND_RADIUS_SHARE: Final = 0.2
"""Radius of a blend as a share of the shorter step beside it: blends never touch."""

SHARPEST_BLENDED_TURN: Final = np.radians(10.0)
"""Where two steps meet at more, there is no blend."""

FEED_TOLERANCE: Final = 0.02
"""Share by which a wire feed may vary along a bead and count as one."""

TOOL_ACCELERATION: Final = 0.5
"""m/s²; of the first move rad/s²."""

AIR_MOVE_SPEED: Final = 0.05
"""m/s, between beads."""

APPROACH_JOINT_SPEED: Final = 0.2
"""rad/s of the leading joint, to where the first bead begins."""


@dataclass(frozen=True, slots=True, eq=False)
class BeadPath:
    """How an arm leads the torch to a bead, along it, and away.

    Parameters
    ----------
    bead : PlannedBead
        The bead, or a station's part of it.
    approach : ndarray, shape (k, 4, 4)
        Poses of the wire's tip on the way to the bead, the last one at its start; in frame b.
    path : ndarray, shape (q, 4, 4)
        At each of its points.
    retreat : ndarray, shape (l, 4, 4)
        On the way from its end.
    """

    bead: PlannedBead
    approach: Array
    path: Array
    retreat: Array

    def woven(self, weave: WeaveSettings | None) -> tuple[Array, Array]:
        """Poses of the wire's tip along the bead, and when it is there, seconds since the strike.

        Parameters
        ----------
        weave : WeaveSettings or None
            How it swings where the bead's segments ask for it.

        Returns
        -------
        tuple of ndarray, shape (k, 4, 4) and (k,)
        """
        times, swings = self.bead.times, self.bead.weave
        if weave is None or not swings.any():
            return self.path, times
        corners = weave_corners(weave.period, weave.dwell)[1:5]
        swung = np.arange(0.0, times[-1], weave.period)[:, None]
        at = np.unique(np.concatenate((times[[0, -1]], (swung + corners).ravel())))
        at = at[at <= times[-1]]
        T = np.tile(np.eye(4), (len(at), 1, 1))
        turns = scipy.spatial.transform.Rotation.from_matrix(self.path[:, :3, :3])
        T[:, :3, :3] = scipy.spatial.transform.Slerp(times, turns)(at).as_matrix()
        way = scipy.interpolate.interp1d(times, self.path[:, :3, 3], axis=0)(at)
        aside = np.interp(at, times, swings) * weave_swing(at, weave.period, weave.dwell)
        T[:, :3, 3] = way + aside[:, None] * T[:, :3, 1]
        return T, at


@dataclass(frozen=True, slots=True, eq=False)
class StationPath:
    """How the arm of a station leads the torch along all of its beads.

    Parameters
    ----------
    station : str
        Its name.
    q : ndarray, shape (6,)
        Joint angles at the first pose, radians.
    beads : tuple of BeadPath
        In the order of welding.
    before, after : tuple of str
        Stations that weld their part of each layer before this one, and after it.
    """

    station: str
    q: Array
    beads: tuple[BeadPath, ...]
    before: tuple[str, ...] = ()
    after: tuple[str, ...] = ()

    def hold_text(self, i: int, wps: WeldingProcedure) -> str:
        """What an operator has to wait for before bead i; empty if nothing."""
        layer = self.beads[i].bead.layer
        if i and self.beads[i - 1].bead.layer == layer:
            return ""
        waits = [f"{name} has welded layer {layer}" for name in self.before]
        if i:
            waits += [f"{name} has welded layer {layer - 1}" for name in self.after]
            below = self.beads[i - 1].bead.layer
            waits += [f"layer {below} is released"] * (below in wps.sequence.hold_after_layers)
        return " and ".join(waits)

    def check_feeds(self) -> None:
        """Refuse a bead along which the wire feed varies: its speed would follow a feed not set.

        Raises
        ------
        ConfigurationError
            Naming the bead.
        """
        for one in self.beads:
            low, high = (float(x) / M_PER_MIN.factor for x in np.sort(one.bead.feed)[[0, -1]])
            if high > (1 + FEED_TOLERANCE) * low:
                raise ConfigurationError(
                    f"the wire feed goes from {low:.2f} to {high:.2f} m/min along bead "
                    f"{one.bead.number}, and no output of the arm sets it: with crater_feed = 1, "
                    "and without [[position]] or in one position, a program can switch the arc; "
                    "without --arc it is written as it is",
                    key="start_stop.crater_feed",
                )


def path_to_urscript(path: StationPath, wps: WeldingProcedure, output: int, *, arc: bool) -> str:
    """Write the path of a station's torch as a URScript program.

    Parameters
    ----------
    path : StationPath
        The path.
    wps : WeldingProcedure
        With the torch and the weave.
    output : int
        Number of the standard digital output that switches the arc.
    arc : bool
        Whether it is switched on on the beads; else it stays off throughout.

    Raises
    ------
    ConfigurationError
        With the arc, if the wire feed varies along a bead.
    """
    if arc:
        path.check_feeds()
    feeds = [f"{one.bead.feed[0] / M_PER_MIN.factor:.2f} m/min" for one in path.beads]
    joints = ", ".join(f"{x:.7f}" for x in path.q)
    lines = [
        "def tjscan_plan():",
        "  # in the arm's base frame: metres, rotation vectors in radians",
        f"  # wire feed is not set here, and begins with {feeds[0]}; the arc is "
        f"{'switched' if arc else 'never switched on'}",
        f"  set_standard_digital_out({output}, False)",
        f"  set_tcp({_pose_text(wps.torch.tcp.T)})",
        "  # the way from where the arm is to here is not checked",
        f"  movej([{joints}], a={TOOL_ACCELERATION}, v={APPROACH_JOINT_SPEED})",
    ]
    for i, one in enumerate(path.beads):
        lines.append(f"  # bead {one.bead.number}: {one.bead.kind}, layer {one.bead.layer}")
        if arc and i and wps.sequence.interpass_wait:
            lines.append(f"  sleep({wps.sequence.interpass_wait:g})")
        waits = [path.hold_text(i, wps)]
        if arc and feeds[i] != (feeds[i - 1] if i else None):
            waits.append(f"the wire feed is set to {feeds[i]}")
        if hold := " and ".join(filter(None, waits)):
            lines.append(f'  popup("go on when {hold}", title="hold", blocking=True)')
        lines += _movel_lines(one.approach)
        lines += _bead_move_lines(one, wps, output, arc=arc)
        lines += _movel_lines(one.retreat)
    return "\n".join((*lines, "end", ""))


def _bead_move_lines(
    one: BeadPath, wps: WeldingProcedure, output: int, *, arc: bool
) -> Iterator[str]:
    if arc:
        yield f"  set_standard_digital_out({output}, True)"
    poses, times = one.woven(wps.weave)
    chords = np.diff(poses[:, :3, 3], axis=0)
    steps = np.linalg.norm(chords, axis=1)
    speeds = steps / np.diff(times)  # a step has one speed
    turns = np.einsum("ij,ij->i", chords[1:], chords[:-1]) / (steps[1:] * steps[:-1])
    blended = np.append(turns > np.cos(SHARPEST_BLENDED_TURN), False)
    blends = BLEND_RADIUS_SHARE * blended * np.minimum(steps, np.append(steps[1:], np.inf))
    for T, speed, blend in zip(poses[1:], speeds, blends, strict=True):
        yield f"  movep({_pose_text(T)}, a={TOOL_ACCELERATION}, v={speed:.6f}, r={blend:.6f})"
    if arc and wps.crater_time:
        yield f"  sleep({wps.crater_time:g})"
    yield f"  set_standard_digital_out({output}, False)"


def _movel_lines(poses: Array | Sequence[Array]) -> Iterator[str]:
    for T in poses:
        yield f"  movel({_pose_text(T)}, a={TOOL_ACCELERATION}, v={AIR_MOVE_SPEED})"


def _pose_text(T: Array) -> str:
    return f"p[{', '.join(f'{x:.7f}' for x in np.asarray(pose_to_vector(T)))}]"
