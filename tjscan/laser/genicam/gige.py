"""What all lasers behind GigE Vision share as a `LineLaser`: connection, triggers, times."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Final, Generic, Self, TypeVar

from tjscan.core.devices import DeviceIdentity, EventListener
from tjscan.core.errors import (
    LaserFault,
    LaserNotResponding,
    ProfileFormatRefused,
    WrongLaser,
)
from tjscan.core.process import ClientClosed, ClientDied, ClientProcess, ClientSilent
from tjscan.laser.genicam.clock import HostInterval, cell_time_of_exposure
from tjscan.laser.genicam.messages import ConnectedLaser, ReceivedBlock, StreamSetup
from tjscan.laser.genicam.settings import GigeSettings
from tjscan.laser.profile import Profile

S = TypeVar("S", bound=GigeSettings)
T = TypeVar("T")

ANSWER_SLACK: Final = 2.0
"""Seconds beyond its own time-outs that the client's process may take on a busy machine."""

GIVE_BACK: Final = 1.0
"""Seconds that giving the laser back may take; after that its heartbeat does it."""

TAKEN_AGAIN: Final = "profile taken again"
"""Event of a profile that took more than one trigger."""


class GigeLaser(ABC, Generic[S]):
    """Base of `LineLaser`s behind GigE Vision; subclasses define what their payload means.

    Parameters
    ----------
    settings : GigeSettings
        How to reach it.
    time : callable
        Gives the seconds on the clock of the cell.
    """

    def __init__(self, settings: S, time: Callable[[], float]) -> None:
        self.settings, self._time = settings, time
        self._process: ClientProcess | None = None
        self._listener: EventListener = lambda name, detail: None
        self._known: DeviceIdentity | None = None
        self._laser: ConnectedLaser | None = None

    def __enter__(self) -> Self:
        """Connect, set the laser up, and read what its numbers mean.

        Raises
        ------
        LaserNotConnected, LaserInUse, LaserNotResponding
            If it can't be had.
        WrongLaser
            If another laser answers than the job states, or than answered before.
        ProfileFormatRefused
            If its numbers can't be turned into millimetres.
        """
        table = self.settings
        self._process = ClientProcess("tjscan.laser.genicam.client")
        try:
            self._laser = self._call(
                ConnectedLaser,
                "connect",
                limit=table.connect_limit,
                address=table.address,
                serial=table.serial,
                features=dict(table.features),
                packet_size=table.packet_size,
                setup=self._setup(),
            )
            self._check_identity(self._laser.identity)
            self._understand(self._laser)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        """Give the laser back, and end the client's process whatever it is doing."""
        process, self._process = self._process, None
        if process is not None:
            process.close(patience=GIVE_BACK)

    @property
    def identity(self) -> DeviceIdentity:
        """Which laser it is; known while connected."""
        return self.connected.identity

    @property
    def connected(self) -> ConnectedLaser:
        """What the laser states about itself.

        Raises
        ------
        LaserFault
            Outside a ``with`` block.
        """
        self._client  # noqa: B018 - refuses
        if self._laser is None:
            raise LaserFault("the laser has not been connected yet")
        return self._laser

    def report_events_to(self, listener: EventListener) -> None:
        """Report profiles that took more than one trigger."""
        self._listener = listener

    def capture(self) -> Profile:
        """Take one profile that is exposed after this call.

        Its time is on the cell's clock, as the laser's own clock has the exposure.

        Raises
        ------
        LaserNotResponding, LaserInUse
            If the laser, or the control over it, was lost.
        ProfileNotReceived, ProfileStale, ProfileFormatRefused
            If it sends no whole profile, none from after the call, or something else.
        """
        table, laser = self.settings, self.connected
        before = time.monotonic()
        cell = self._time()
        read = HostInterval(before, time.monotonic())
        block = self._call(
            ReceivedBlock,
            "capture",
            limit=table.attempts * table.timeout + ANSWER_SLACK,
            attempts=table.attempts,
            timeout=table.timeout,
        )
        if block.attempts > 1:
            self._listener(TAKEN_AGAIN, f"it came with attempt {block.attempts}")
        if laser.pixel_format and block.pixel_format != laser.pixel_format:
            raise ProfileFormatRefused(
                f"the laser sends {block.pixel_format}, and was set to {laser.pixel_format}. "
                "Start again."
            )
        when, uncertainty = cell_time_of_exposure(block.exposed, block.uncertainty, cell, read)
        return self._profile(block, when, uncertainty)

    @abstractmethod
    def _setup(self) -> StreamSetup:
        """How its stream is set up."""

    @abstractmethod
    def _understand(self, laser: ConnectedLaser) -> None:
        """Find out what its payload means, or refuse it; the laser has just been connected."""

    @abstractmethod
    def _profile(self, block: ReceivedBlock, time: float, uncertainty: float) -> Profile:
        """The profile in a block, of this time on the cell's clock."""

    def _link(self, size: int) -> str:
        """Its link in words, for profiles of so many bytes."""
        laser = self.connected
        clock = (
            "its clock can be read"
            if laser.latches
            else "its clock can't be read, so that its stream restarts for each profile"
        )
        count = -(-size // max(laser.packet_size, 1))
        return (
            f"{laser.address}, about {count} packets of at most {laser.packet_size} bytes a "
            f"profile, {clock}"
        )

    def _advice(self) -> str:
        """What the job should state."""
        if self.settings.serial is not None:
            return ""
        return (
            f'state serial = "{self.identity.serial}" in the job, so that its calibration holds '
            "for this laser alone"
        )

    @property
    def _client(self) -> ClientProcess:
        if self._process is None:
            raise LaserFault("the laser is not connected: capture inside a `with` block")
        return self._process

    def _call(self, kind: type[T], name: str, *, limit: float, **arguments: object) -> T:
        """Call a method of `camera.GenicamClient` in its process, and return what it returns.

        Raises
        ------
        LaserNotResponding
            If it does not answer in time, or died. It is ended then.
        LaserFault
            What the method raised.
        """
        try:
            answer = self._client.ask(name, limit=limit, **arguments)
        except ClientClosed:
            raise LaserNotResponding(
                "the connection to the laser has ended. Connect again."
            ) from None
        except ClientDied as died:
            raise LaserNotResponding(f"the laser's client has ended.{died} Start again.") from None
        except ClientSilent:
            raise LaserNotResponding(
                f"the laser did not answer within {limit:.2g} s ({name}). See that it is on and "
                "its network cable sits, then start again."
            ) from None
        if isinstance(answer.failure, LaserFault):
            raise answer.failure
        if not isinstance(answer.value, kind):
            raise LaserFault(f"{name} gave {answer.value!r}")
        return answer.value

    def _check_identity(self, found: DeviceIdentity) -> None:
        if self.settings.serial is not None and found.serial != self.settings.serial:
            raise WrongLaser(
                f"the laser that answers is {found}, and the job is for serial number "
                f"{self.settings.serial}. A calibration holds for one laser alone: put that one "
                "back, or calibrate this one and state its serial in the job."
            )
        if self._known is not None and found != self._known:
            raise WrongLaser(
                f"the laser that answers is {found}, and it was {self._known} before. A "
                "calibration holds for one laser alone."
            )
        self._known = found
