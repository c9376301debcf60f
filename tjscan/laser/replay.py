"""A line laser that plays back recorded profiles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

from tjscan.core.errors import LaserFault
from tjscan.laser.profile import Profile


class ReplayedLaser:
    """The laser of a recording, behind the `LineLaser` protocol.

    Parameters
    ----------
    profiles : sequence of Profile
        Its profiles, in the order of the recording.
    take : callable
        Gives the number of the profile that is taken now, as the arm that carried the laser
        stands; raises LaserFault where none was.
    """

    def __init__(self, profiles: Sequence[Profile], take: Callable[[], int]) -> None:
        self._profiles, self._take = tuple(profiles), take
        self._connected = False

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._connected = False

    def capture(self) -> Profile:
        """Give the profile that was recorded from where the arm stands.

        Raises
        ------
        LaserFault
            Outside a ``with`` block, or if no further profile was taken from there.
        """
        if not self._connected:
            raise LaserFault("the recording is not open: capture inside a `with` block")
        return self._profiles[self._take()]
