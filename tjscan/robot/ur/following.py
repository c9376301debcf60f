"""A Universal Robots arm that follows a path which grows, by a program of our own.

The program (``following.urscript``) holds a path to rest at any time, and runs along it tick by
tick. A new path is taken over as a whole, or not at all: what is lost on the way costs time, never
the path. Where nothing comes any more, the arm rests at the path's end.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.resources import files
from string import Template
from types import NoneType
from typing import Final

import numpy as np

from tjscan.core import errors, pose_vector
from tjscan.robot.arm import ArmState
from tjscan.robot.following import Following, JointMotion
from tjscan.robot.ur import knot_link
from tjscan.robot.ur.knot_link import PathReport
from tjscan.robot.ur.moving import MOVE_POLL_PERIOD, start_program
from tjscan.robot.ur.session import NEXT_STATE_REPORT_DELAY, ControllerSession

SHORTEST_PIECE: Final = 5e-4
"""Seconds between two knots at least."""

ANSWER_LIMIT: Final = 0.3
"""Seconds that the answer to a path is waited for before the next."""

FINISH_LIMIT: Final = 3.0
"""Seconds within which the program ends once it is stopped."""

FAULT_LOOKS: Final = 10
"""Looks at the controller's state, a report apart, until it shows why its program ended."""


def following_program() -> str:
    """The program that follows knots, in URScript."""
    zeros = "[" + ", ".join(["0.0"] * 2 * knot_link.MOST_KNOTS) + "]"
    text = files("tjscan.robot.ur").joinpath("following.urscript").read_text(encoding="utf-8")
    knots = "[" + ", ".join([zeros[1:-1]] * 6) + "]"
    came = zeros.replace("0.0", "0")
    bank = knot_link.MOST_KNOTS
    return Template(text).substitute(bank=bank, times=zeros, came=came, knots=knots)


def extended_path(before: JointMotion, later: JointMotion, now: float) -> tuple[JointMotion, int]:
    """A path from where the arm is on it, to rest, and the first knot that is new.

    Up to that knot it is the path before to the last digit, wherever the arm is by the time it
    is taken over: the knot itself is laid on it.

    Parameters
    ----------
    before, later : JointMotion
        The path before, and the one that replaces it from its first knot on.
    now : float
        Where the arm is on the path before, in its seconds.

    Raises
    ------
    PathNotExtended
        If the later path comes too late, does not join, or has too many knots.
    """
    joined = before.replaced_by(later, now)
    start = float(later.times[0])
    begun = max(int(np.searchsorted(joined.times, now, side="right")) - 1, 0)
    kept = (joined.times < start - SHORTEST_PIECE) | (joined.times >= start)
    kept[begun] = True
    kept[:begun] = False
    path = JointMotion(joined.times[kept], joined.q[kept], joined.speed[kept])
    if len(path.times) > knot_link.MOST_KNOTS:
        raise errors.PathNotExtended(
            f"a path to follow has {len(path.times)} knots from where the arm is, "
            f"{knot_link.MOST_KNOTS} are possible"
        )
    return path, len(path.times) - len(later.times)


class UrFollowing:
    """An arm while it follows paths, see `Following`.

    Its paths are on the controller's clock, from which the arm falls behind while the speed
    slider is not at 100 %: `now` is where it is on them.

    Parameters
    ----------
    session : ControllerSession
        The session with its controller, on which the program runs.
    """

    def __init__(self, session: ControllerSession) -> None:
        self._session, self._states = session, list[ArmState]()
        self._epoch, self._answered, self._refused, self._since = 0, True, False, np.inf
        self._origin = np.nan
        self._await_begin()
        self._motion = self._before = JointMotion.at_rest(self._states[-1].q, self.now)

    @property
    def end(self) -> float:
        """When the path that is followed ends. See `Following.end`."""
        return self._motion.end

    def states(self) -> Sequence[ArmState]:
        """States since the last call. See `Following.states`."""
        self._refresh()
        found, self._states = self._states, []
        return found

    def replace(self, motion: JointMotion) -> None:
        """Follow another path. See `Following.replace`."""
        self._session.ensure_dashboard_connected()
        self._refresh()
        self._await_answer()
        path, first = extended_path(self._motion, motion, self.now)
        self._before, self._motion, self._since = self._motion, path, float(motion.times[0])
        self._epoch, self._answered = self._epoch + 1, False
        sent = (self._epoch, path.times - self._origin, path.q, path.speed, first)
        self._session.call_client_method(NoneType, "send_knots", *sent)

    def _refresh(self) -> None:
        """Take what came, and see that the program runs."""
        if self._session.latch.wait_for_stop(0.0):
            raise errors.ArmFault(
                "the arm was stopped on its path. See that the way is clear, then start again."
            )
        for _ in range(FAULT_LOOKS):
            report = self._report()
            if report.runs and report.silence < self._session.settings.silence_limit:
                break
            if report.silence == np.inf:
                raise self._session.end_session_for_fault(_fault_of_path(report))
            self._session.read_state()  # its fault, by name
            time.sleep(NEXT_STATE_REPORT_DELAY)
        else:
            raise self._session.end_session_for_fault(_fault_of_path(report))
        for at, *values in report.states:
            T_b_f = pose_vector.pose_from_vector(np.array(values[6:])) @ self._session.T_tcp_f
            self._states.append(ArmState(np.array(values[:6]), T_b_f, at))
        self.now = report.path_time + self._origin
        if not self._answered:
            late = report.verdict != self._epoch and self.now > self._since
            self._refused = late or report.verdict == -self._epoch
            self._answered = self._refused or report.verdict == self._epoch
            if self._refused:
                self._motion = self._before

    def _report(self) -> PathReport:
        return self._session.call_client_method(PathReport, "report_path")

    def _await_begin(self) -> None:
        """Wait until the program goes along its path, which is rest, and set the path's clock."""
        limit, first = time.monotonic() + FINISH_LIMIT, self._report()
        while (report := self._report()).path_time == first.path_time or not report.runs:
            self._session.read_state(beside_program=True)
            if time.monotonic() > limit:
                raise errors.ArmNotResponding(
                    "the arm does not begin to follow. See that the speed slider on its pendant "
                    "is not at zero, then start again."
                )
            time.sleep(MOVE_POLL_PERIOD)
        self._origin = report.time - report.path_time
        while not self._states:
            self._refresh()

    def _await_answer(self) -> None:
        """Wait until the path that was sent last is followed; raises as `replace` does."""
        limit = time.monotonic() + ANSWER_LIMIT
        while not self._answered:
            if time.monotonic() > limit:
                raise errors.PathNotExtended(
                    "the controller has not answered to the path sent before: its speed slider is "
                    "at zero, or the network slow"
                )
            time.sleep(MOVE_POLL_PERIOD)
            self._refresh()
        if self._refused:
            self._refused = False
            raise errors.PathNotExtended(
                "the path sent before came too late to the controller, which follows the one "
                "before that to its end"
            )


def _fault_of_path(report: PathReport) -> errors.ArmFault:
    """Fault that the reports of a path show, where the controller's state shows none."""
    if report.silence == np.inf:
        return errors.ArmConnectionLost(
            "the link on which the arm's controller takes its path broke. See that the arm is at "
            "rest and its network cable sits, then start again."
        )
    return errors.ArmNotResponding(
        f"the arm's controller reports nothing of its path for {report.silence:.1f} s. See "
        "that the arm is at rest, look at its pendant and cable, then start again."
    )


@contextmanager
def follow_paths(session: ControllerSession) -> Iterator[Following]:
    """Follow paths from where the arm is, at rest; see `FollowingArm.follow`.

    Parameters
    ----------
    session : ControllerSession
        The session with the controller; its control script has ended afterwards.
    """
    session.ensure_dashboard_answers()
    session.read_state()
    session.call_client_method(NoneType, "begin_following", session.settings.host)
    try:
        start_program(session, following_program())
        yield UrFollowing(session)
    finally:
        if session.fault is None:
            _finish(session)


def _finish(session: ControllerSession) -> None:
    """Let the arm come to rest on its path, and its program end."""
    limit = time.monotonic() + FINISH_LIMIT
    session.call_client_method(NoneType, "stop_following")
    while session.call_client_method(PathReport, "report_path").runs:
        if time.monotonic() > limit:
            session.dashboard.stop_program()
            break
        time.sleep(MOVE_POLL_PERIOD)
    session.call_client_method(bool, "end_following")
