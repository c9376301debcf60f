"""The client library in a process of its own: ``python -m tjscan.laser.genicam.client HANDLE``.

Its calls wait for four seconds and more on a laser that fell silent, one after the other, and so
does its end. Here the main process ends it at any time. When the main process is gone, this one
gives the laser back and ends.

This is the only file that knows the client library, viva-genicam.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from math import gcd, inf
from multiprocessing.connection import Connection
from typing import Any, Final

import viva_genicam

from tjscan.core import errors
from tjscan.core.devices import DeviceIdentity
from tjscan.core.process import ClientMethodCall
from tjscan.core.signals import ignore_ctrl_c
from tjscan.laser.genicam import messages
from tjscan.laser.genicam.receiving import BlockReceiver
from tjscan.laser.genicam.settings import FeatureValue, GenicamSettings, ScanControlSettings

DISCOVERY_TIMEOUT_MS: Final = (100, 300, 900)
"""Milliseconds to wait for answers to each broadcast, until a laser is given up. Most answer at
once; a datagram may get lost, and GigE Vision lets an answer take up to a second."""

HEARTBEAT_PATIENCE: Final = 3.2
"""Seconds for which a laser stays with a program that was killed: GigE Vision's usual heartbeat."""

LASER_CLOCK_READINGS: Final = 10
"""Readings of a laser's clock; two must differ. Together they take milliseconds."""

TRIGGER_SELECTORS: Final = ("FrameStart", "LineStart", "FrameBurstStart")
"""What a trigger may start, the first that there is."""

CLOCK_CHECK_DURATION: Final = 0.3
"""Seconds for which a laser's clock is held against this computer's before a stream."""

COARSEST_CLOCK: Final = 1e-4
"""Seconds by which a clock may go on at a time: at 0.2 m/s the flange moves by 0.02 mm."""

LARGEST_CLOCK_ERROR: Final = 0.01
"""Of a clock's rate: more is another number of ticks a second, no drift."""

SLOWEST_SHARE: Final = 0.2
"""Of the profiles a second that are wanted, which a laser can take at least."""

SILENCE_UNTIL_ASKED: Final = 2.0
"""Seconds without a block after which a laser is asked whether it is still there."""

CLIENT_PRIORITY: Final = -10
"""Of this process on the machine, as `nice` counts: it has little to do, and that at once."""

SETTINGS_LOOK_PERIOD: Final = 1.0
"""Seconds between looks whether a laser that streams still is as it was set up."""

LINK_LOST_WORDS: Final = ("timeout", "timed out", "refused", "unreachable")
"""Of errors that no feature causes, but the link."""

RATE_FEATURE: Final = "AcquisitionFrameRate"

STEPWISE_ADVICE: Final = 'Else set mode = "stepwise" in [scan]: the arm stands for each profile'

PREFERRED_PIXEL_FORMATS: Final = ("Coord3D_AC16", "Coord3D_AC32f", "Coord3D_C16")

# GigE Vision's bootstrap registers, which every device has at the same place; of a text also
# its bytes.
VENDOR_TEXT, MODEL_TEXT, VERSION_TEXT, SERIAL_TEXT = (0x48, 32), (0x68, 32), (0x88, 32), (0xD8, 16)
TICKS_PER_SECOND, TIME_CONTROL, LATCHED_TIME = 0x93C, 0x944, 0x948
PRIVILEGE_REGISTER, PACKET_SIZE = 0xA00, 0xD04
CLOCK_LATCH_COMMAND: Final = (2).to_bytes(4, "big")

GenicamError: Any = viva_genicam.GenicamError


class GenicamClient:
    """A laser, and the stream of its blocks."""

    def __init__(self) -> None:
        self._camera: Any = None
        self._stream: Any = None
        self._waits_for_trigger = False
        self._margin: float | None = None
        self._ticks_per_second = 0
        self._latches = False
        self._exposure: float | None = None
        self._may_set_rate = True
        self._connected: messages.ConnectedLaser | None = None
        self._receiver: BlockReceiver | None = None
        self._began: int | None = None
        self._heard = self._looked = 0.0

    def connect(self, settings: GenicamSettings | ScanControlSettings) -> messages.ConnectedLaser:
        """Connect, set everything up, and begin to stream."""
        address = self._open_laser(settings.address, settings.serial)
        for name, value in settings.features.items():
            self._set_feature(name, value)
        chosen, self._may_set_rate = "", RATE_FEATURE not in settings.features
        if isinstance(settings, ScanControlSettings):
            self._margin = settings.margin
            for register, number in settings.registers.items():
                self._camera.write_register(int(register, 16), number.to_bytes(4))
        else:
            self._waits_for_trigger = settings.trigger == "software"
            if settings.exposure is not None:
                self._camera.set_exposure_time(1e6 * settings.exposure)
            chosen = self._choose_pixel_format(settings.pixel_format)
            self._set_feature("Height", settings.rows)
        if self._waits_for_trigger:
            if "TriggerSoftware" not in self._feature_names:
                raise errors.ProfileFormatRefused(
                    "the laser can't be triggered by software: let it run free at the sensor, and "
                    'set trigger = "fresh" in [laser.genicam]'
                )
            self._camera.enable_trigger(self._choose_trigger(), "Software")
        elif "TriggerMode" in self._feature_names:
            self._camera.disable_trigger(self._choose_trigger())
        with suppress(GenicamError):
            self._exposure = 1e-6 * self._camera.exposure_time()
        self._ticks_per_second = int.from_bytes(self._camera.read_register(TICKS_PER_SECOND, 8))
        self._latches = self._ticks_per_second > 0 and self._can_read_clock()
        if settings.packet_size is not None:
            self._camera.write_register(PACKET_SIZE, settings.packet_size.to_bytes(4))
        laser = messages.ConnectedLaser(
            identity=self.identity(),
            address=address,
            pixel_format=chosen,
            columns=self._read_feature("Width", self._camera.get_integer) or 0,
            rows=self._read_feature("Height", self._camera.get_integer) or 0,
            packet_size=int.from_bytes(self._camera.read_register(PACKET_SIZE)) & 0xFFFF,
            unit=self._read_enum("Scan3dDistanceUnit"),
            output_mode=self._read_enum("Scan3dOutputMode"),
            exposure=self._exposure,
            **self._read_axes(),
            latches=self._latches,
            ticks_per_second=self._ticks_per_second,
        )
        self._open_stream()
        self._connected = laser
        return laser

    def identity(self) -> DeviceIdentity:
        """Read who the laser is."""
        places = (VENDOR_TEXT, MODEL_TEXT, VERSION_TEXT, SERIAL_TEXT)
        vendor, model, version, serial = (_read_text(self._camera, place) for place in places)
        return DeviceIdentity(f"{vendor} {model}".strip(), serial, version)

    def capture(self, attempts: int, timeout: float) -> messages.CapturedBlock:
        """Take a block that was exposed after this call; trigger again while none comes."""
        self.end_stream()
        latched, latched_at = self._latch_clock()
        stale, began = 0, time.monotonic()
        for attempt in range(1, attempts + 1):
            until = time.monotonic() + timeout
            if self._waits_for_trigger:
                self._camera.trigger_software()
            while (wait := until - time.monotonic()) > 0:
                block = self._next_block(wait)
                if block is None:
                    break
                if self._latches and block.ticks < latched + self._ticks_until_fresh_exposure:
                    stale += 1
                    continue
                when, later = messages.HostInterval(began, block.came), block.ticks - latched
                if self._latches:
                    later += round((self._exposure or 0.0) / 2 * self._ticks_per_second)
                    when = messages.host_time_of_exposure(later, self._ticks_per_second, latched_at)
                return messages.CapturedBlock(
                    block, when.midpoint, when.half_length, attempts=attempt, **self._read_axes()
                )
        if stale:
            raise errors.ProfileStale(
                f"{stale} profiles came in {attempts} attempts, all exposed before they were asked "
                "for. See that nothing else triggers the laser, and that its buffer is off."
            )
        raise errors.ProfileNotReceived(
            f"no whole profile came in {attempts} attempts of {1e3 * timeout:.0f} ms. See that "
            "the cable, the switch and the packet size carry the stream, and that the laser is "
            "not waiting for another trigger."
        )

    def check_stream(self, rate: float) -> None:
        """Refuse a stream whose stamps tell nothing, or that is far from a number of profiles/s."""
        if self._exposure is None or self._read_enum("ExposureAuto") not in (None, "Off"):
            raise errors.LaserStampsRefused(
                "the laser chooses its exposure itself, or does not state it, so that the middle "
                'of it is not known. Set laser.genicam.exposure_us, and ExposureAuto = "Off" in '
                f"laser.genicam.features. {STEPWISE_ADVICE}"
            )
        most = self._fastest_rate()
        if most < SLOWEST_SHARE * rate:
            raise errors.LaserStampsRefused(
                f"the laser takes at most {most:g} profiles a second, and {SLOWEST_SHARE * rate:g} "
                "are needed. Set a shorter exposure or a smaller range at the sensor. "
                f"{STEPWISE_ADVICE}"
            )
        readings = [self._read_clock()]
        while readings[-1][1].end < readings[0][1].begin + CLOCK_CHECK_DURATION:
            time.sleep(CLOCK_CHECK_DURATION / LASER_CLOCK_READINGS)
            readings.append(self._read_clock())
        (first, began), (last, ended) = readings[0], readings[-1]
        if last == first or self._ticks_per_second == 0:
            raise errors.LaserStampsRefused(
                "the laser's clock can't be read, or it does not state how many ticks it has a "
                f"second, so that its stamps can't be checked. {STEPWISE_ADVICE}"
            )
        resolution = gcd(*(ticks - first for ticks, _ in readings[1:])) / self._ticks_per_second
        if resolution > COARSEST_CLOCK:
            raise errors.LaserStampsRefused(
                f"the laser's clock goes on by {1e3 * resolution:g} ms at a time, and its stamps "
                f"have to be good to {1e3 * COARSEST_CLOCK:g} ms. {STEPWISE_ADVICE}"
            )
        passed = (last - first) / self._ticks_per_second
        host, doubt = ended.midpoint - began.midpoint, began.half_length + ended.half_length
        if abs(passed - host) > LARGEST_CLOCK_ERROR * host + doubt:
            raise errors.LaserStampsRefused(
                f"the laser's clock went on by {1e3 * passed:.1f} ms in {1e3 * host:.1f} ms: it "
                f"has other ticks than the {self._ticks_per_second:,} a second that it states. "
                f"{STEPWISE_ADVICE}"
            )

    def begin_stream(self, rate: float) -> None:
        """Let the laser run free, at a number of profiles a second if that can be set."""
        self.end_stream()
        self._close_stream()
        if self._waits_for_trigger:
            self._camera.disable_trigger(self._choose_trigger())
        if self._may_set_rate and RATE_FEATURE in self._feature_names:
            self._camera.set_frame_rate(min(rate, self._fastest_rate()))
        self._began = self._read_clock()[0] if self._margin is None else None
        self._open_stream()
        self._heard = self._looked = time.monotonic()
        self._receiver = BlockReceiver(self._next_block)

    def take_blocks(self, wait: float) -> list[messages.StampedBlock | None]:
        """Blocks that came since the last call, None for each lost one; see `BlockReceiver.take`.

        While none comes it is seen that the laser still answers.
        """
        if self._receiver is None:
            raise errors.LaserFault("the laser's stream has ended")
        blocks, now = self._receiver.take(wait), time.monotonic()
        if now - self._looked > SETTINGS_LOOK_PERIOD:
            self._looked = now
            self._refuse_changes()
        if blocks:
            self._heard = now
        elif now - self._heard > SILENCE_UNTIL_ASKED:
            self._heard = now
            self._read_clock()
        return blocks

    def _refuse_changes(self) -> None:
        """Refuse to go on where the laser no longer is as it was set up."""
        was = self._connected
        if was is None or self._margin is not None:
            return
        if self._read_axes() != {"x": was.x, "z": was.z}:
            self._read_clock()  # or the laser is gone, and states nothing
            raise errors.ProfileFormatRefused(
                "the laser's Scan3dCoordinateScale, -Offset or -AxisMin and -Max changed while it "
                "streamed. See that nothing else sets it up, then go on with --resume"
            )
        if self._read_feature("ExposureTime", self._camera.get_float) != 1e6 * (was.exposure or 0):
            raise errors.LaserStampsRefused(
                "the laser's ExposureTime changed while it streamed, and with it what its stamps "
                "mean. See that nothing else sets it up, then go on with --resume"
            )

    def end_stream(self) -> None:
        """Let the laser do as it did before the stream, if there is one."""
        if self._receiver is None:
            return
        self._receiver.close()
        self._receiver = None
        self._close_stream()
        if self._waits_for_trigger:
            self._camera.enable_trigger(self._choose_trigger(), "Software")
        self._open_stream()

    def close(self) -> None:
        """Stop the stream and give the laser back."""
        if self._receiver is not None:
            self._receiver.close()
        if self._stream is not None:
            with suppress(GenicamError):
                self._close_stream()
        if self._camera is not None:
            with suppress(GenicamError):
                self._camera.close()
        self._stream = self._camera = None

    def explain_error(self, error: Exception) -> errors.LaserFault:
        """Fault that an error means: a fault itself, or one that the library raised."""
        if isinstance(error, errors.LaserFault):
            return error
        words = str(error)
        if "ACCESS_DENIED" in words or "control of the camera was lost" in words:
            with suppress(GenicamError):
                if any(self._camera.read_register(PRIVILEGE_REGISTER)):
                    return errors.LaserInUse(
                        "another program has taken control of the laser. Close it there, then "
                        "start again."
                    )
            return errors.LaserNotResponding(
                "the laser no longer takes commands: it was restarted, or its connection broke. "
                "Start again."
            )
        lost = any(word in words.lower() for word in LINK_LOST_WORDS)
        if isinstance(error, viva_genicam.GenApiError) and not lost:
            return errors.ProfileFormatRefused(f"the laser does not do as it is set up: {words}")
        return errors.LaserNotResponding(
            f"the laser does not answer: {words}. See its power and cable."
        )

    def _open_stream(self) -> None:
        self._stream = self._camera.stream()  # from here on features may be locked
        self._stream.__enter__()

    def _close_stream(self) -> None:
        self._stream.__exit__(None, None, None)

    def _next_block(self, wait: float) -> messages.StampedBlock | None:
        """The next block of the stream; none if none came in that time."""
        try:
            frame = self._stream.next_frame(max(1, round(1e3 * wait)))
        except viva_genicam.TransportError:
            return None
        if frame is None:
            raise errors.LaserNotResponding("the laser's stream has ended. Connect again.")
        came, ticks = time.monotonic(), frame.ts_dev or 0
        if self._began is not None:
            self._check_first_stamp(ticks, self._began)
            self._began = None
        return messages.StampedBlock(
            data=frame.payload(),
            pixel_format=frame.pixel_format,
            columns=frame.width,
            rows=frame.height,
            number=frame.block_id,
            ticks=ticks,
            came=came,
        )

    def _check_first_stamp(self, ticks: int, began: int) -> None:
        """Refuse stamps that are not of the clock that is read."""
        now, _ = self._read_clock()
        if not began <= ticks <= now:
            what = f"is {ticks}, while its clock went from {began} to {now}" if ticks else "is 0"
            raise errors.LaserStampsRefused(
                f"the stamp of the laser's first profile {what}: it does not tell when that was "
                f"taken. See that its stream has time stamps, by its own clock. {STEPWISE_ADVICE}"
            )

    def _fastest_rate(self) -> float:
        """Profiles a second at most; infinite if it does not say."""
        most = None
        if RATE_FEATURE in self._feature_names:
            state = self._camera.feature_state(RATE_FEATURE)
            most = state.range and state.range.max
        return inf if most is None else float(most)

    def _read_enum(self, name: str) -> Any:
        return self._read_feature(name, self._camera.get_enum)

    @property
    def _feature_names(self) -> set[str]:
        return set(self._camera.nodes())

    @property
    def _ticks_until_fresh_exposure(self) -> float:
        """Device time from the call to the first exposure that counts.

        A trigger exposes after the call. What runs free may state when the exposure ended.
        """
        if self._waits_for_trigger:
            return 0.0
        margin = self._exposure if self._margin is None else self._margin
        return (margin or 0.0) * self._ticks_per_second

    def _open_laser(self, address: str | None, serial: str | None) -> str:
        """Find and control the laser; gives its address."""
        seen: dict[str, str] = {}
        for patience in DISCOVERY_TIMEOUT_MS:
            for info in viva_genicam.discover(timeout_ms=patience, all=True):
                seen[info.ip] = f"{info.manufacturer} {info.model} at {info.ip}"
                # Which laser it is that has the address is judged later.
                if info.ip == address or (address is None and _read_serial_number(info) == serial):
                    self._camera = self._take_control(info)
                    return str(info.ip)
        others = f"; there is {', '.join(seen.values())}" if seen else ""
        wanted = f"at {address}" if address is not None else f"with serial number {serial}"
        raise errors.LaserNotConnected(
            f"no laser {wanted} answers{others}. See that it is on, that its cable sits, and that "
            "this computer has an address in its subnet."
        )

    def _take_control(self, info: Any) -> Any:
        """Take control of a laser; one that was left to its heartbeat comes free by itself."""
        until = time.monotonic() + HEARTBEAT_PATIENCE
        while True:
            try:
                return viva_genicam.connect_gige(info)
            except GenicamError as error:
                if "ACCESS_DENIED" not in str(error):
                    raise errors.LaserNotConnected(
                        f"the laser at {info.ip} fails: {error}"
                    ) from error
                if time.monotonic() > until:
                    message = f"another program controls the laser at {info.ip}. Close it there."
                    raise errors.LaserInUse(message) from error
            time.sleep(0.1)

    def _choose_pixel_format(self, wanted: str | None) -> str:
        there = self._camera.available_enum_entries("PixelFormat")
        candidates = PREFERRED_PIXEL_FORMATS if wanted is None else (wanted,)
        chosen = next((name for name in candidates if name in there), None)
        if chosen is None:
            raise errors.ProfileFormatRefused(
                f"the laser has no {' or '.join(candidates)}; it has {', '.join(there)}. Choose "
                "one with laser.genicam.pixel_format"
            )
        self._camera.set_enum("PixelFormat", chosen)
        return chosen

    def _choose_trigger(self) -> str:
        there = self._read_feature("TriggerSelector", self._camera.available_enum_entries) or ()
        return next((name for name in TRIGGER_SELECTORS if name in there), TRIGGER_SELECTORS[0])

    def _set_feature(self, name: str, value: FeatureValue) -> None:
        text = str(value).lower() if isinstance(value, bool) else str(value)
        try:
            if isinstance(value, bool):
                self._camera.set_bool(name, value)
            elif isinstance(value, float):
                self._camera.set_float(name, value)
            else:
                self._camera.set(name, text)
        except GenicamError as error:
            message = f"the laser's feature {name} can't be set to {text}: {error}"
            raise errors.ProfileFormatRefused(message) from error

    def _read_feature(self, name: str, read: Callable[[str], Any]) -> Any:
        """A feature's value; None if the laser lacks it."""
        with suppress(GenicamError):
            return read(name)
        return None

    def _read_axes(self) -> dict[str, messages.StatedAxis]:
        """What the laser states of x and z."""
        return {
            "x": self._read_axis_scale("CoordinateA"),
            "z": self._read_axis_scale("CoordinateC"),
        }

    def _read_axis_scale(self, coordinate: str) -> messages.StatedAxis:
        if "Scan3dCoordinateSelector" not in self._feature_names:
            return messages.StatedAxis()
        with suppress(GenicamError):
            self._camera.set_enum("Scan3dCoordinateSelector", coordinate)
            number = self._camera.get_float
            marks = self._read_feature("Scan3dInvalidDataFlag", self._camera.get_bool)
            return messages.StatedAxis(
                scale=self._read_feature("Scan3dCoordinateScale", number),
                offset=self._read_feature("Scan3dCoordinateOffset", number),
                low=self._read_feature("Scan3dAxisMin", number),
                high=self._read_feature("Scan3dAxisMax", number),
                invalid=self._read_feature("Scan3dInvalidDataValue", number) if marks else None,
            )
        return messages.StatedAxis()

    def _can_read_clock(self) -> bool:
        """Whether the laser's clock can be read: two readings differ."""
        readings = set()
        for _ in range(LASER_CLOCK_READINGS):
            with suppress(GenicamError):
                self._camera.write_register(TIME_CONTROL, CLOCK_LATCH_COMMAND)
                readings.add(self._camera.read_register(LATCHED_TIME, 8))
        return len(readings) > 1

    def _latch_clock(self) -> tuple[int, messages.HostInterval]:
        """Read the laser's clock now, and when that was; without a clock, restart the stream.

        What an acquisition that has just begun brings was exposed after that.
        """
        if not self._latches:
            self._camera.acquisition_stop()
            with suppress(viva_genicam.TransportError):
                while self._stream.next_frame(1) is not None:
                    pass
            self._camera.acquisition_start()
            return 0, messages.HostInterval(0.0, 0.0)
        return self._read_clock()

    def _read_clock(self) -> tuple[int, messages.HostInterval]:
        """What the laser's clock shows, and when; raises if the laser does not obey."""
        before = time.monotonic()
        self._camera.write_register(TIME_CONTROL, CLOCK_LATCH_COMMAND)
        after = time.monotonic()
        ticks = int.from_bytes(self._camera.read_register(LATCHED_TIME, 8))
        return ticks, messages.HostInterval(before, after)


def _read_serial_number(info: Any) -> str:
    """Serial number of a laser that was discovered, read without taking control of it."""
    try:
        with viva_genicam.connect_gige(info, monitor=True) as camera:
            return _read_text(camera, SERIAL_TEXT)
    except GenicamError:
        return ""  # it was there a moment ago


def _read_text(camera: Any, place: tuple[int, int]) -> str:
    text: bytes = camera.read_register(*place)
    return text.split(b"\0")[0].decode(errors="replace")


def main() -> None:
    """Serve the main process's requests on the connection whose number is the only argument."""
    ignore_ctrl_c()
    with suppress(OSError):  # if this user may: the library drops what is not taken within 20 ms
        os.setpriority(os.PRIO_PROCESS, 0, CLIENT_PRIORITY)
    client, connection = GenicamClient(), Connection(int(sys.argv[1]))
    with suppress(EOFError, OSError):  # the main process is gone
        while True:
            request: ClientMethodCall = connection.recv()
            connection.send(request.run_on_client(client, client.explain_error))
    client.close()
    os._exit(0)  # without waiting for the library's threads


if __name__ == "__main__":
    main()
