"""Lasers behind GigE Vision as a `LineLaser`: with Scan3d features, and scanCONTROL."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from math import inf
from types import NoneType
from typing import Final, Generic, Self, TypeVar

from tjscan.core.devices import DeviceBase, DeviceIdentity
from tjscan.core.errors import (
    LaserFault,
    LaserNotResponding,
    LaserStampsRefused,
    ProfileFormatRefused,
    WrongLaser,
)
from tjscan.core.process import ClientProcess
from tjscan.laser import scancontrol
from tjscan.laser.genicam.messages import (
    CapturedBlock,
    ConnectedLaser,
    HostInterval,
    StampedBlock,
    StatedAxis,
    exposure_on_cell_clock,
)
from tjscan.laser.genicam.settings import GenicamSettings, GigeSettings, ScanControlSettings
from tjscan.laser.line_laser import LaserDescription, StreamedProfile
from tjscan.laser.profile import Profile
from tjscan.laser.scan3d import COORDINATE_FORMATS, AxisScale, Scan3dScales, profile_of_row

S = TypeVar("S", bound=GigeSettings)
T = TypeVar("T")

STREAM_ANSWER_LIMIT: Final = 5.0
"""Seconds in which a stream begins or ends."""

BLOCK_WAIT: Final = 0.02
"""Seconds for which a block is waited for at a time."""

ANSWER_SLACK: Final = 2.0
"""Seconds beyond its own time-outs that the client's process may take on a busy machine."""

LASER_RELEASE_TIMEOUT: Final = 1.0
"""Seconds that giving the laser back may take; after that its heartbeat does it."""

RETRIGGERED_PROFILE_EVENT: Final = "profile taken again"
"""Event of a profile that took more than one trigger."""


class GigeLaser(DeviceBase, ABC, Generic[S]):
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
        self._known: DeviceIdentity | None = None
        self._laser: ConnectedLaser | None = None
        self._streams = 0

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
        self._process = ClientProcess(
            "tjscan.laser.genicam.client", "the laser", LaserNotResponding, LaserNotResponding
        )
        table, limit = self.settings, self.settings.connect_limit
        try:
            self._laser = self._ask_client(ConnectedLaser, "connect", table, limit=limit)
            self._check_identity(self._laser.identity)
            self._check_payload(self._laser)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        """Give the laser back, and end the client's process whatever it is doing."""
        process, self._process = self._process, None
        self._streams += 1
        if process is not None:
            process.close(patience=LASER_RELEASE_TIMEOUT)

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
        table = self.settings
        self.connected  # noqa: B018 - refuses
        before = time.monotonic()
        cell = self._time()
        read = HostInterval(before, time.monotonic())
        attempts, timeout = table.attempts, table.timeout
        limit = attempts * timeout + ANSWER_SLACK
        found = self._ask_client(CapturedBlock, "capture", attempts, timeout, limit=limit)
        if found.attempts > 1:
            self._listener(RETRIGGERED_PROFILE_EVENT, f"it came with attempt {found.attempts}")
        # What a laser states may change with each profile.
        profile = self._parse_block(found.block, replace(self.connected, x=found.x, z=found.z))
        when, uncertainty = exposure_on_cell_clock(found.exposed, found.uncertainty, cell, read)
        return replace(profile, time=when, time_uncertainty=uncertainty)

    def check_stream(self, period: float) -> None:
        """Refuse a stream whose times can't be true. See `StreamingLaser.check_stream`."""
        self._ask_client(NoneType, "check_stream", 1 / period, limit=STREAM_ANSWER_LIMIT)

    def stream(self, period: float) -> Iterator[StreamedProfile | None]:
        """Let it run free; see `StreamingLaser.stream`.

        The client's process receives, however busy this one is.

        Raises
        ------
        LaserNotResponding, LaserInUse
            If the laser, or the control over it, was lost.
        LaserStampsRefused, ProfileFormatRefused
            If its stamps are not of its clock, or it sends something else.
        LaserFault
            If more than a minute of profiles wait.
        """
        number = self._streams = self._streams + 1
        self._ask_client(NoneType, "begin_stream", 1 / period, limit=STREAM_ANSWER_LIMIT)
        try:
            while True:
                limit = BLOCK_WAIT + ANSWER_SLACK
                blocks = self._ask_client(list, "take_blocks", BLOCK_WAIT, limit=limit)
                for block in blocks or [None]:
                    yield None if block is None else self._streamed_profile(block)
        finally:
            if self._process is not None and self._streams == number:
                with suppress(LaserFault):  # what comes next ends it, too
                    self._ask_client(NoneType, "end_stream", limit=STREAM_ANSWER_LIMIT)

    def _streamed_profile(self, block: StampedBlock) -> StreamedProfile:
        profile = self._parse_block(block, self.connected)
        profile = replace(profile, time=self._time_of_stamp(block))
        return StreamedProfile(profile, time.monotonic() - block.came)

    @abstractmethod
    def _time_of_stamp(self, block: StampedBlock) -> float:
        """Middle of a block's exposure on the laser's clock, seconds."""

    @abstractmethod
    def _check_payload(self, laser: ConnectedLaser) -> None:
        """Find out what its payload means, or refuse it; the laser has just been connected."""

    def _parse_block(self, block: StampedBlock, laser: ConnectedLaser) -> Profile:
        """The profile in a block, without its time, of a laser that states what it does then."""
        if laser.pixel_format and block.pixel_format != laser.pixel_format:
            raise ProfileFormatRefused(
                f"the laser sends {block.pixel_format}, and was set to {laser.pixel_format}. Start "
                "again."
            )
        return self._parse_payload(block, laser)

    @abstractmethod
    def _parse_payload(self, block: StampedBlock, laser: ConnectedLaser) -> Profile:
        """The profile in a block whose format is as it was set."""

    @abstractmethod
    def _describe_payload(self) -> tuple[int, str, list[float]]:
        """Bytes of a profile, what it sends, and both limits of z that it can state, metres."""

    def describe(self) -> LaserDescription:
        """Describe the laser and its link; raises as `connected` does."""
        laser, (size, payload, limits) = self.connected, self._describe_payload()
        clock, advice = f"its clock has {laser.ticks_per_second:,} ticks a second", ""
        if not laser.latches:
            clock = "its clock can't be read, so that its stream restarts for each profile"
        if self.settings.serial is None:
            advice = (
                f'state serial = "{laser.identity.serial}" in the job, so that its calibration '
                "holds for this laser alone"
            )
        count = -(-size // max(laser.packet_size, 1))
        most = f"at most {laser.packet_size} bytes"
        link = f"{laser.address}, about {count} packets of {most} a profile, {clock}"
        return LaserDescription(link, payload, min(limits), max(limits), advice)

    @property
    def _client(self) -> ClientProcess:
        if self._process is None:
            raise LaserFault("the laser is not connected: capture inside a `with` block")
        return self._process

    def _ask_client(self, kind: type[T], name: str, *arguments: object, limit: float) -> T:
        """Call a method of `client.GenicamClient` in its process, and return what it returns.

        Raises
        ------
        LaserNotResponding
            If it does not answer in time, or died. It is ended then.
        LaserFault
            What the method raised.
        """
        answer = self._client.call_method(name, *arguments, limit=limit)
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


MILLIMETER_UNIT: Final = "Millimeter"
METRES_PER_MM: Final = 1e-3

SCALE_ADVICE: Final = (
    "State laser.genicam.scale_mm and laser.genicam.offset_mm, for x and z, from its manual"
)


def scales_of_laser(laser: ConnectedLaser, settings: GenicamSettings) -> Scan3dScales:
    """Scale, offset, limits and invalid value of both axes.

    Parameters
    ----------
    laser : ConnectedLaser
        What it states.
    settings : GenicamSettings
        What the job states.

    Raises
    ------
    ProfileFormatRefused
        If neither states what the numbers mean, or the laser states that they are no millimetres.
    """
    layout = COORDINATE_FORMATS.get(laser.pixel_format)
    if layout is None:
        raise ProfileFormatRefused(
            f"the laser is set to {laser.pixel_format}; what can be read is "
            f"{', '.join(COORDINATE_FORMATS)}"
        )
    if settings.scale is not None and settings.offset is not None:
        pairs = list(zip(settings.scale, settings.offset, strict=True))
    else:
        _check_states_millimetres(laser)
        pairs = [_stated_scale_and_offset(axis, laser) for axis in (laser.x, laser.z)]
    axes, flips = [], (settings.flip_x, settings.flip_z)
    for (scale, offset), axis, flip in zip(pairs, (laser.x, laser.z), flips, strict=True):
        limits = _raw_number_limits(axis) if settings.axis_limits else (-inf, inf)
        found = AxisScale(scale, offset, *limits)
        axes.append(found.flipped_axis() if flip else found)
    invalid = laser.z.invalid if settings.invalid is None else settings.invalid
    return Scan3dScales(axes[0], axes[1], invalid)


def _check_states_millimetres(laser: ConnectedLaser) -> None:
    if laser.output_mode is not None and laser.output_mode.startswith("Uncalibrated"):
        raise ProfileFormatRefused(
            f"the laser's Scan3dOutputMode is {laser.output_mode}: its numbers are no lengths. Set "
            "a calibrated or rectified one, with laser.genicam.features.Scan3dOutputMode"
        )
    if laser.unit != MILLIMETER_UNIT:
        what = "does not state it" if laser.unit is None else f"states {laser.unit}"
        raise ProfileFormatRefused(
            f"the laser {what}: its Scan3dDistanceUnit should be {MILLIMETER_UNIT}. {SCALE_ADVICE}"
        )


def _stated_scale_and_offset(axis: StatedAxis, laser: ConnectedLaser) -> tuple[float, float]:
    """Scale and offset in metres, as the laser states them."""
    if axis.scale is None or axis.offset is None:
        raise ProfileFormatRefused(
            f"the laser does not state Scan3dCoordinateScale and Scan3dCoordinateOffset of its "
            f"{laser.pixel_format}. {SCALE_ADVICE}"
        )
    return METRES_PER_MM * axis.scale, METRES_PER_MM * axis.offset


def _raw_number_limits(axis: StatedAxis) -> tuple[float, float]:
    """Least and greatest raw number, where they bound anything."""
    if axis.low is None or axis.high is None or not axis.low < axis.high:
        return -inf, inf
    return axis.low, axis.high


class GenicamLaser(GigeLaser[GenicamSettings]):
    """A `LineLaser` that speaks GigE Vision with GenICam's Scan3d features.

    Parameters
    ----------
    settings : GenicamSettings
        How to reach it, and what its numbers mean if it does not state that.
    time : callable
        Gives the seconds on the clock of the cell.
    """

    @property
    def scales(self) -> Scan3dScales:
        """How its numbers become metres; raises as `connected` does."""
        return scales_of_laser(self.connected, self.settings)

    def _describe_payload(self) -> tuple[int, str, list[float]]:
        laser, scales, table = self.connected, self.scales, self.settings
        layout = COORDINATE_FORMATS[laser.pixel_format]
        axes = ", ".join(
            f"{name} = {1e3 * axis.scale:.6g} mm * raw {1e3 * axis.offset:+.6g} mm"
            for name, axis in (("x", scales.x), ("z", scales.z))
        )
        stated = "as the laser states" if table.scale is None else "as the job states"
        sent = f"{laser.pixel_format}, {laser.columns} points, rows: {laser.rows}, {axes}, {stated}"
        limits = [scales.z.scale * raw + scales.z.offset for raw in layout.raw_range(scales.z)]
        return layout.point_size * laser.columns * laser.rows, sent, limits

    def _check_payload(self, laser: ConnectedLaser) -> None:
        scales_of_laser(laser, self.settings)  # refuses what it can't read

    def _parse_payload(self, block: StampedBlock, laser: ConnectedLaser) -> Profile:
        if block.columns != laser.columns:
            raise ProfileFormatRefused(
                f"a profile has {block.columns} points, and the laser stated a Width of "
                f"{laser.columns}. See that nothing else sets its region of interest, then start "
                "again."
            )
        row = COORDINATE_FORMATS[block.pixel_format].point_size * block.columns
        if len(block.data) < row:
            raise ProfileFormatRefused(
                f"a block of {len(block.data)} bytes holds no {block.columns} points in "
                f"{block.pixel_format}"
            )
        scales = scales_of_laser(laser, self.settings)
        return profile_of_row(block.data[:row], block.pixel_format, scales)

    def check_stream(self, period: float) -> None:
        """Refuse blocks of several rows, too: they have one stamp. See `GigeLaser`."""
        if self.settings.rows != 1:
            raise LaserStampsRefused(
                f"a block of {self.settings.rows} rows has the stamp of one: set "
                'laser.genicam.rows = 1, or mode = "stepwise" in [scan]'
            )
        super().check_stream(period)

    def _time_of_stamp(self, block: StampedBlock) -> float:
        laser = self.connected
        return block.ticks / laser.ticks_per_second + (laser.exposure or 0.0) / 2


class ScanControlLaser(GigeLaser[ScanControlSettings]):
    """A `LineLaser` with the transport of GigE Vision and a payload of its own.

    It runs free, and what its stream stamps earlier than the call, and the margin after it, is
    thrown away. No such sensor was at hand: the payload is read as its documents have it.

    Parameters
    ----------
    settings : ScanControlSettings
        How to reach it, and how it is set up.
    time : callable
        Gives the seconds on the clock of the cell.
    """

    def __init__(self, settings: ScanControlSettings, time: Callable[[], float]) -> None:
        super().__init__(settings, time)
        self._shutter: float | None = None

    def _describe_payload(self) -> tuple[int, str, list[float]]:
        table, scale = self.settings, self.settings.count_scale
        raw = (
            (scancontrol.MAX_RAW_VALUE - 1, 0) if table.flip_z else (1, scancontrol.MAX_RAW_VALUE)
        )  # 0 as sent is no point
        sent = (
            f"{table.layout} profiles, {table.points} points, {1e3 * scale.scale:g} mm a count "
            f"about x 0 and z {1e3 * scale.offset:g} mm, as the job states"
        )
        limits = [
            scale.scale * (end - scancontrol.RAW_COORDINATE_OF_ZERO) + scale.offset for end in raw
        ]
        return scancontrol.scancontrol_profile_size(table), sent, limits

    def _check_payload(self, laser: ConnectedLaser) -> None:
        """Nothing is asked: the job states how it is set up."""

    def _parse_payload(self, block: StampedBlock, laser: ConnectedLaser) -> Profile:
        return scancontrol.parse_scancontrol(block.data, self.settings)

    def check_stream(self, period: float) -> None:
        """Its times come with the points; how many profiles a second, it was set up for."""
        self.connected  # noqa: B018 - refuses
        if self.settings.layout == "container" and not self.settings.time_stamp:
            raise LaserStampsRefused(
                "containers without a time stamp do not tell when they were taken: let the sensor "
                "send it, and set laser.scancontrol.time_stamp = true"
            )

    def _time_of_stamp(self, block: StampedBlock) -> float:
        if len(block.data) > scancontrol.scancontrol_profile_size(self.settings):
            raise LaserStampsRefused(
                "the sensor sends several profiles in a container: let it send one, or set "
                'mode = "stepwise" in [scan]'
            )
        middle = scancontrol.middle_of_shutter(block.data)
        if self._shutter is None:
            self._shutter = middle
        self._shutter += (middle - self._shutter) % scancontrol.CLOCK_TURN
        return self._shutter
