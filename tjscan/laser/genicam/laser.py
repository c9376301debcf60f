"""A GenICam laser as a `LineLaser`."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import Final, Self

from tjscan.core.devices import DeviceIdentity, EventListener
from tjscan.core.errors import LaserFault, ProfileFormatRefused, WrongLaser
from tjscan.laser.genicam.clock import HostInterval, cell_time_of_exposure
from tjscan.laser.genicam.link import GenicamProcess
from tjscan.laser.genicam.messages import ConnectedLaser, ReceivedBlock
from tjscan.laser.genicam.scales import scales_of_laser
from tjscan.laser.genicam.settings import GenicamSettings
from tjscan.laser.line_laser import LaserDescription
from tjscan.laser.profile import Profile
from tjscan.laser.scan3d import FORMATS, Scan3dScales, points

ANSWER_SLACK: Final = 2.0
"""Seconds beyond its own time-outs that the client's process may take on a busy machine."""

GIVE_BACK: Final = 1.0
"""Seconds that giving the laser back may take; after that its heartbeat does it."""

TAKEN_AGAIN: Final = "profile taken again"
"""Event of a profile that took more than one trigger."""


class GenicamLaser:
    """A `LineLaser` that speaks GigE Vision with GenICam's Scan3d features.

    Parameters
    ----------
    settings : GenicamSettings
        How to reach it, and what its numbers mean where it does not say.
    time : callable
        Gives the seconds on the clock of the cell.
    """

    def __init__(self, settings: GenicamSettings, time: Callable[[], float]) -> None:
        self.settings, self._time = settings, time
        self._process: GenicamProcess | None = None
        self._listener: EventListener = lambda name, detail: None
        self._known: DeviceIdentity | None = None
        self._laser: ConnectedLaser | None = None
        self._scales: Scan3dScales | None = None

    def __enter__(self) -> Self:
        """Connect, set the laser up, and read what its numbers mean.

        Raises
        ------
        LaserNotConnected, LaserInUse, LaserNotResponding
            If it can't be had.
        WrongLaser
            If another laser answers than the job says, or than answered before.
        ProfileFormatRefused
            If its numbers can't be turned into millimetres.
        """
        table = self.settings
        self._process = GenicamProcess()
        try:
            self._laser = self._process.call(
                ConnectedLaser,
                "connect",
                limit=table.connect_limit,
                address=table.address,
                serial=table.serial,
                pixel_format=table.pixel_format,
                exposure=table.exposure,
                rows=table.rows,
                trigger=table.trigger,
                features=dict(table.features),
                packet_size=table.packet_size,
            )
            self._check_identity(self._laser.identity)
            self._scales = scales_of_laser(self._laser, table)
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the laser back, and end the client's process whatever it is doing."""
        process, self._process = self._process, None
        if process is not None:
            process.close(give_back=GIVE_BACK)

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
        if self._laser is None or self._process is None:
            raise LaserFault("the laser is not connected: capture inside a `with` block")
        return self._laser

    @property
    def scales(self) -> Scan3dScales:
        """How its numbers become metres; raises as `connected` does."""
        self.connected  # noqa: B018 - refuses
        if self._scales is None:
            raise LaserFault("the laser's numbers are not known")
        return self._scales

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
        table, process, laser, scales = self.settings, self._process, self.connected, self.scales
        if process is None:
            raise LaserFault("the laser is not connected: capture inside a `with` block")
        before = time.monotonic()
        cell = self._time()
        read = HostInterval(before, time.monotonic())
        block = process.call(
            ReceivedBlock,
            "capture",
            limit=table.attempts * table.timeout + ANSWER_SLACK,
            attempts=table.attempts,
            timeout=table.timeout,
        )
        if block.attempts > 1:
            self._listener(TAKEN_AGAIN, f"it came with attempt {block.attempts}")
        if block.pixel_format != laser.pixel_format:
            raise ProfileFormatRefused(
                f"the laser sends {block.pixel_format}, and was set to {laser.pixel_format}. "
                "Start again."
            )
        when, uncertainty = cell_time_of_exposure(block.exposed, block.uncertainty, cell, read)
        row = FORMATS[laser.pixel_format].point_size * block.columns
        return points(block.data[:row], block.pixel_format, scales, when, uncertainty)

    def describe(self) -> LaserDescription:
        """Describe the laser and its link; raises as `connected` does."""
        laser, scales, table = self.connected, self.scales, self.settings
        layout = FORMATS[laser.pixel_format]
        pieces = -(-layout.point_size * laser.columns * laser.rows // laser.packet_size)
        clock = (
            "its clock can be read"
            if laser.latches
            else "its clock can't be read, so it starts anew for each profile"
        )
        axes = ", ".join(
            f"{name} = {1e3 * axis.scale:.6g} mm * raw {1e3 * axis.offset:+.6g} mm"
            for name, axis in (("x", scales.x), ("z", scales.z))
        )
        stated = "as the laser states" if table.scale is None else "as the job states"
        ends = [scales.z.scale * raw + scales.z.offset for raw in layout.raw_range(scales.z)]
        return LaserDescription(
            link=f"{laser.address}, about {pieces} packets of at most {laser.packet_size} bytes a "
            f"profile, {clock}",
            format=f"{laser.pixel_format}, {laser.columns} points, rows: {laser.rows}, {axes}, "
            f"{stated}",
            near=min(ends),
            far=max(ends),
            advice=""
            if table.serial is not None
            else f'state serial = "{laser.identity.serial}" in the job, so that its calibration '
            "holds for this laser alone",
        )

    def _check_identity(self, found: DeviceIdentity) -> None:
        if self.settings.serial is not None and found.serial != self.settings.serial:
            raise WrongLaser(
                f"the laser that answers is {found}, and the job is for serial number "
                f"{self.settings.serial}. A calibration holds for one laser alone: put that one "
                "back, or calibrate this one and state its number in laser.genicam.serial."
            )
        if self._known is not None and found != self._known:
            raise WrongLaser(
                f"the laser that answers is {found}, and it was {self._known} before. A "
                "calibration holds for one laser alone."
            )
        self._known = found
