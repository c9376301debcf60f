"""A vehicle behind an MQTT broker."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from dataclasses import asdict
from math import inf
from queue import Empty, SimpleQueue
from typing import Final

from tjscan.core import errors
from tjscan.core.devices import DeviceIdentity
from tjscan.core.frames import Array, pose, rot_z
from tjscan.vehicle.mqtt import wire
from tjscan.vehicle.mqtt.link import BrokerClient, ReceivedMessage
from tjscan.vehicle.mqtt.settings import MqttSettings
from tjscan.vehicle.ordered_motion import OrderedMotion
from tjscan.vehicle.vehicle import AT_REST, Twist, VehicleState, check_twist, merge_unread_states

ORDER_REPEAT_PERIOD: Final = 0.05
"""Seconds after which the last order is sent again."""

ANNOUNCEMENT_PERIOD: Final = 0.25
"""Seconds after which a program that is not obeyed yet announces itself again."""

STOP_REPEATED_FOR: Final = 1.0
"""Seconds for which a stop is sent though another program commands the vehicle by now."""

ORDER_TOPICS: Final = (wire.STOP_TOPIC, wire.COMMAND_TOPIC)
"""A stop is sent on both, a drive on the last one."""

MOST_WAITING_STATES: Final = 300
"""States that wait to be read, 3 s of them; older ones are dropped then. Without one its way is not
known: it is more than any program may be held up for that goes on."""


class MqttVehicle(BrokerClient):
    """A vehicle behind an MQTT broker, behind the `Vehicle` protocol.

    A thread sends each command as it comes, and again every 50 ms as long as it is not older
    than the dead-man time; else it sends a stop. So the vehicle drives only while its
    commander is alive, and stops too when it hears nothing.

    Parameters
    ----------
    settings : MqttSettings
        The broker, and the vehicle's topics there.
    """

    def __init__(self, settings: MqttSettings) -> None:
        self.settings = settings
        self.dead_man = settings.dead_man
        super().__init__(
            settings,
            wire.COMMANDER_TOPIC,
            (wire.PRESENCE_TOPIC, wire.STATE_TOPIC, wire.POSE_TOPIC, *ORDER_TOPICS),
        )

    def _reset_before_connecting(self) -> None:
        self._states: SimpleQueue[tuple[VehicleState, wire.PoseMessage | None] | None]
        self._states = SimpleQueue()
        self._wake: SimpleQueue[bool] = SimpleQueue()
        self._gate, self._pose_gate = wire.MessageGate(), wire.PoseGate()
        self._order_gate = wire.MessageGate()
        self._order: tuple[Twist, float] | None = None
        self._ordered, self._has_commanded = OrderedMotion(), False
        self._echoed = dict.fromkeys(ORDER_TOPICS, 0)
        self._alarm_told = False
        self._newest_pose: wire.PoseMessage | None = None
        self._read_until: float | None = None
        self._pose: wire.PoseMessage | None = None  # at the last state that was read
        self._identity = DeviceIdentity()
        self._fault = self._commander = self._lost = self._alarm = ""
        self._heard, self._stopped, self._stopped_at = time.monotonic(), False, -inf
        super()._reset_before_connecting()
        self._order_gate.session = self._session

    def _leave_at_rest(self) -> None:
        """Stop the vehicle."""
        self.stop()
        self._connected = False
        self._wake.put(True)
        self._sender.join()

    @property
    def identity(self) -> DeviceIdentity:
        """Which vehicle it is, as it announces itself."""
        return self._identity

    def command(self, twist: Twist) -> None:
        """Hold a twist until the next command. See `Vehicle.command`."""
        self._note_call()
        self._deliver_events()
        self._check_link()
        check_twist(twist)
        if self._fault:
            raise errors.DriveFault(
                f"the vehicle reports: {self._fault}. Mend it, then start again."
            )
        if self._commander not in ("", self._session):
            raise self._other_commander_error()
        self._check_no_alarm()
        if self._stopped:
            raise errors.VehicleStopped
        self._order = twist, time.monotonic()
        self._wake.put(True)

    def next_state(self) -> VehicleState:
        """Wait for the next state. See `Vehicle.next_state`."""
        self._note_call()
        self._deliver_events()
        self._check_no_alarm()
        if not self._connected:
            self._check_link()
        try:
            waiting = [self._states.get(timeout=self.settings.silence_limit)]
        except Empty:
            raise self._link_lost_error() from None
        with suppress(Empty):
            while True:
                waiting.append(self._states.get_nowait())
        received = [one for one in waiting if one is not None]
        if len(received) < len(waiting):
            raise self._link_lost_error()
        self._pose = received[-1][1]
        merged = merge_unread_states([state for state, _ in received], self._read_until)
        self._read_until = merged.time
        self._called = time.monotonic()  # to wait was no pause
        return merged

    def true_pose(self) -> Array:
        """True pose T_w_v, shape (4, 4), at the last state, of a stand-in that sends it before.

        Raises
        ------
        ConfigurationError
            If none was sent.
        """
        message = self._pose
        if message is None:
            raise errors.ConfigurationError(
                f"nothing sends the pose of {self.settings.prefix}; a simulated laser needs a "
                "vehicle of tjscan vehicle-loopback",
                key="vehicle.driver",
            )
        return pose(rot_z(message.heading), (message.x, message.y, 0.0))

    def stop(self) -> None:
        """Bring the vehicle to rest, and take no command any more. See `Vehicle.stop`."""
        self._stopped, self._stopped_at = True, time.monotonic()
        if self._connected:
            self._wake.put(True)

    def accept_commands_again(self) -> None:
        """Take commands again after a stop. See `Vehicle.accept_commands_again`."""
        if self._alarm_told:  # else it holds
            self._alarm, self._alarm_told = "", False
        self._order, self._stopped = None, bool(self._alarm)

    # What the driver's own thread does

    def _send_orders(self) -> None:
        while self._connected:
            self._send_order(time.monotonic())
            with suppress(Empty):
                self._wake.get(timeout=ORDER_REPEAT_PERIOD)
                while not self._wake.empty():
                    self._wake.get()
        self._send_order(time.monotonic())  # the stop with which it ends

    def _send_order(self, now: float) -> None:
        order, hold = self._order, 0.0
        if order is not None and not self._stopped:
            hold = max(order[1] + self.dead_man - now, 0.0)
        twist = order[0] if order is not None and hold else AT_REST
        superseded = self._commander not in ("", self._session)
        if superseded and not hold and now > self._stopped_at + STOP_REPEATED_FOR:
            return  # it would stop who commands the vehicle now
        self._has_commanded |= self._commander == self._session
        if not self._has_commanded:
            return  # another program's vehicle would obey a stop
        self._ordered.order(twist, now)
        word, topics = ("drive", ORDER_TOPICS[1:]) if hold else ("stop", ORDER_TOPICS)
        for topic in topics:
            self._publish(topic, wire.CommandMessage, now, order=word, **asdict(twist), hold=hold)

    # What the link's thread does

    def _handle_message(self, received: ReceivedMessage) -> None:
        if received.topic == wire.PRESENCE_TOPIC:
            self._receive_presence(wire.PresenceMessage.from_json(received.payload))
        elif received.retained:
            raise wire.BadMessage("the broker kept it from before")
        elif received.topic == wire.STATE_TOPIC:
            self._receive_state(wire.StateMessage.from_json(received.payload), received.time)
        elif received.topic in ORDER_TOPICS:
            self._receive_order(received)
        elif received.topic == wire.POSE_TOPIC:
            message = wire.PoseMessage.from_json(received.payload)
            self._pose_gate.measuring_time(message, received.time)
            self._newest_pose = message

    def _receive_presence(self, message: wire.PresenceMessage) -> None:
        if not message.alive:
            if message.session == self._gate.session:
                self._note_lost_link("the vehicle's own link to the broker broke")
            return
        if self._gate.session and message.session != self._gate.session:
            raise wire.BadMessage("another vehicle announced itself, or this one started again")
        self._gate.session = message.session
        self._identity = DeviceIdentity(message.model, message.serial, message.software)
        self._lost = ""

    def _receive_state(self, message: wire.StateMessage, now: float) -> None:
        if not self._gate.session:
            raise wire.BadMessage("the vehicle has not announced itself")
        if reason := self._gate.reason_to_drop(message, now):
            raise wire.BadMessage(reason)
        self._heard, self._lost = now, ""
        self._fault, self._commander = message.fault, message.commander
        odometry = message.state.odometry
        if self._has_commanded and self._ordered.contradicts(odometry, now):
            self._raise_alarm(
                f"the vehicle drives {1e3 * odometry.speed:.0f} mm/s and turns "
                f"{odometry.turn_rate:.2f} rad/s, which this program did not order"
            )
        if self._states.qsize() >= MOST_WAITING_STATES:
            with suppress(Empty):  # they are read this very moment
                self._states.get_nowait()
                self._note_dropped("a state that was not read in time")
        self._states.put((message.state, self._newest_pose))

    def _receive_order(self, received: ReceivedMessage) -> None:
        """See who else commands the vehicle: a broker sends back what this program sent, once.

        It keeps the order of each topic's messages, not of two topics'.
        """
        last = self._echoed[received.topic]
        stops, obeyed, problem = received.topic == wire.STOP_TOPIC, False, ""
        try:
            message = wire.CommandMessage.from_json(received.payload)
        except wire.BadMessage as error:
            problem = str(error)
        else:
            if not stops:  # as the vehicle judges it
                obeyed = not self._order_gate.reason_to_drop(message, received.time)
            if message.session == self._session and last < message.number <= self._number:
                self._echoed[received.topic] = message.number
                return
            stops |= message.order == "stop"
        if (stops or obeyed) and self._has_commanded:  # before, it is who goes
            what = "ordered the vehicle to stop" if stops else "drives it in this program's name"
            self._raise_alarm(f"another client of the broker {what}")
        raise wire.BadMessage(problem or "another client of the broker commands the vehicle")

    def _raise_alarm(self, why: str) -> None:
        """Stop, and end what this program does with the vehicle."""
        if not self._alarm:
            self._alarm = why
            self._events.put(("vehicle-alarm", why))
        self.stop()

    def _link_changed(self, up: bool) -> None:
        if not up and self._connected:
            self._note_lost_link("the link to the broker broke")

    def _note_lost_link(self, why: str) -> None:
        self._order, self._lost = None, why
        self._events.put(("link-lost", why))
        self._states.put(None)

    # What the caller's thread does

    def _wait_until_ready(self) -> None:
        """Wait until the vehicle takes this program's commands."""
        self._sender = threading.Thread(target=self._send_orders, daemon=True)
        self._sender.start()
        until = time.monotonic() + self.settings.connect_limit
        due = time.monotonic() + ANNOUNCEMENT_PERIOD
        s = self.settings
        while self._commander != self._session:
            with suppress(Empty):
                self._states.get(timeout=ANNOUNCEMENT_PERIOD)
            if time.monotonic() > due:  # who commands it may fall silent
                self._link.announce()
                due += ANNOUNCEMENT_PERIOD
            if time.monotonic() > until:
                if self._commander:
                    raise self._other_commander_error()
                raise errors.VehicleLinkLost(
                    f"the broker at {s.host}:{s.port} knows no vehicle {s.prefix} that reports "
                    "states and takes commands. See that it is on, or correct vehicle.mqtt.prefix."
                )
        self._pose = self._newest_pose

    def _check_no_alarm(self) -> None:
        if self._alarm:
            self._alarm_told = True
            raise errors.UnorderedMotion(
                f"{self._alarm}. This program has stopped it. See what else is connected to the "
                f"broker at {self.settings.host}:{self.settings.port}, then start again."
            )

    def _check_link(self) -> None:
        if not self._connected:
            raise errors.VehicleLinkLost(
                "the vehicle is not connected: use it inside a 'with' block"
            )
        if self._lost or time.monotonic() - self._heard > self.settings.silence_limit:
            raise self._link_lost_error()

    def _link_lost_error(self) -> errors.VehicleLinkLost:
        self._order = None
        self._deliver_events()
        limit = self.settings.silence_limit
        why = self._lost or f"no new state came for {limit:g} s"
        return errors.VehicleLinkLost(
            self._held_up(limit)
            or f"{why}. The vehicle stops by itself. See that it and its network are on, then "
            "start again."
        )

    def _other_commander_error(self) -> errors.VehicleFault:
        return errors.VehicleFault(
            f"another program commands the vehicle {self.settings.prefix}. End it first."
        )
