"""One client of an MQTT broker, as vehicles and their drivers use it."""

from __future__ import annotations

import socket
import ssl
import threading
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final, Self
from uuid import uuid4

from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags, MQTTMessage, MQTTMessageInfo
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.reasoncodes import ReasonCode

from tjscan.core.devices import DeviceBase
from tjscan.core.errors import ConfigurationError, VehicleLinkLost
from tjscan.vehicle.mqtt.settings import BrokerSettings, MqttLocalisationSettings, MqttSettings
from tjscan.vehicle.mqtt.wire import REPORTED_DROP_COUNTS, BadMessage, PresenceMessage, WireMessage

BROKER_KEEP_ALIVE: Final = 2
"""Seconds of silence after which a broker asks whether its client is there. It calls the last will
three seconds after a client froze; long before that the vehicle has stopped by itself."""

RECONNECT_DELAY: Final = 1
"""Seconds between attempts to connect again."""

FAREWELL_TIMEOUT: Final = 1.0
"""Seconds that the last message may take."""


@dataclass(frozen=True, slots=True)
class ReceivedMessage:
    """What came on a topic.

    Parameters
    ----------
    topic : str
        Its last part.
    payload : bytes
        What came.
    retained : bool
        Whether the broker kept it from before.
    time : float
        When, `time.monotonic`.
    """

    topic: str
    payload: bytes
    retained: bool
    time: float


@dataclass(eq=False)
class BrokerLink:
    """Connection to a broker that announces its end and comes back when it was cut.

    Parameters
    ----------
    broker : BrokerSettings
        The broker, and the prefix of all topics; nothing else is connected to.
    presence_topic : str
        Topic on which this end announces itself, and the broker that it went.
    presence : PresenceMessage
        Who this end is.
    topics : collection of str, optional
        To listen to.
    receive : callable, optional
        Takes each message, in a thread of the link's own.
    changed : callable, optional
        Takes whether the link is up, each time that changes, in that thread.
    """

    broker: BrokerSettings
    presence_topic: str
    presence: PresenceMessage
    topics: Collection[str] = ()
    receive: Callable[[ReceivedMessage], None] = lambda received: None
    changed: Callable[[bool], None] = lambda up: None

    def __post_init__(self) -> None:
        self._number, self._refused = 0, ""
        self._up = threading.Event()
        self._client = self._make_client()

    @property
    def is_up(self) -> bool:
        """Whether the broker is connected."""
        return self._up.is_set()

    def connect(self, limit: float) -> None:
        """Connect, and stay connected until `close`.

        Parameters
        ----------
        limit : float
            Seconds that may take.

        Raises
        ------
        VehicleLinkLost
            If there is no broker that takes this client.
        ConfigurationError
            If the file of the password or the certificate can't be read.
        """
        host, port = self.broker.host, self.broker.port
        self._refused = ""
        self._client = self._make_client()
        self._identify_itself()
        self._client.connect_timeout = limit
        try:
            self._client.connect(host, port, BROKER_KEEP_ALIVE)
        except ssl.SSLError as error:
            raise VehicleLinkLost(
                f"the MQTT broker at {host}:{port} does not prove who it is: {error}. See that "
                f"{self.broker.ca_file} signs its certificate, which names {host}, and that the "
                "port is the one with TLS"
            ) from None
        except OSError as error:
            raise VehicleLinkLost(
                f"there is no MQTT broker at {host}:{port} ({error}). Start one, for "
                f"instance: mosquitto -p {port}"
            ) from None
        self._client.loop_start()
        if not self._up.wait(limit):
            self.close()
            raise VehicleLinkLost(
                f"the MQTT broker at {host}:{port} does not take this client"
                f"{f': {self._refused}' if self._refused else ''}. See user, password_file and "
                "ca_file, and the broker's log."
            )

    def publish(self, topic: str, payload: bytes) -> None:
        """Send a message, at most once; it is lost if the link is down."""
        self._client.publish(self._full_topic(topic), payload, qos=0)

    def drop(self) -> None:
        """Cut the connection as a broken network does, without a farewell, until `connect`."""
        client, self._client.on_disconnect = self._client, None
        self._up.clear()
        sock = client.socket()
        if isinstance(sock, socket.socket):
            with suppress(OSError):  # cut already
                sock.shutdown(socket.SHUT_RDWR)
        # It ends when it next looks whether to connect again, which must not be waited for.
        threading.Thread(target=client.loop_stop, daemon=True).start()
        self.changed(False)

    def close(self) -> None:
        """Announce that this end goes, and disconnect."""
        if self.is_up:
            with suppress(RuntimeError, ValueError):  # it broke this very moment
                self.announce(alive=False).wait_for_publish(FAREWELL_TIMEOUT)
        self._client.disconnect()
        self._client.loop_stop()

    def _make_client(self) -> Client:
        client = Client(CallbackAPIVersion.VERSION2, client_id=f"tjscan-{self.presence.session}")
        client.reconnect_delay_set(RECONNECT_DELAY, RECONNECT_DELAY)
        client.on_connect, client.on_disconnect = self._on_connect, self._on_disconnect
        client.on_message, client.on_socket_open = self._on_message, _send_without_delay
        client.will_set(
            self._full_topic(self.presence_topic),
            replace(self.presence, alive=False).to_json(),
            qos=1,
            retain=True,
        )
        return client

    def _identify_itself(self) -> None:
        broker, file = self.broker, ""
        try:
            if file := broker.password_file:
                password = Path(file).read_text(encoding="utf-8").rstrip("\r\n")
                self._client.username_pw_set(broker.user, password)
            elif broker.user:
                self._client.username_pw_set(broker.user)
            if file := broker.ca_file:
                self._client.tls_set(file)
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigurationError(f"can't use {file} for the broker's link: {error}") from None

    def _full_topic(self, topic: str) -> str:
        return f"{self.broker.prefix}/{topic}"

    def announce(self, *, alive: bool = True) -> MQTTMessageInfo:
        """Say who this end is, and whether it is there."""
        self._number += 1
        message = replace(self.presence, alive=alive, number=self._number, time=time.monotonic())
        return self._client.publish(
            self._full_topic(self.presence_topic), message.to_json(), qos=1, retain=True
        )

    def _on_connect(
        self, client: Client, data: Any, flags: ConnectFlags, code: ReasonCode, properties: Any
    ) -> None:
        if code.is_failure:
            self._refused = str(code)
            return
        if self.topics:
            client.subscribe([(self._full_topic(topic), 0) for topic in self.topics])
        self.announce()
        self._up.set()
        self.changed(True)

    def _on_disconnect(
        self, client: Client, data: Any, flags: DisconnectFlags, code: ReasonCode, properties: Any
    ) -> None:
        self._up.clear()
        self.changed(False)

    def _on_message(self, client: Client, data: Any, message: MQTTMessage) -> None:
        topic = message.topic.removeprefix(f"{self.broker.prefix}/")
        self.receive(
            ReceivedMessage(topic, bytes(message.payload), message.retain, time.monotonic())
        )


class BrokerClient(DeviceBase):
    """Base of devices behind a broker: their link, their messages, and what they report.

    Simple queues and single assignments share all there is between the threads, no locks: a
    signal's handler may stop a vehicle whatever it interrupts.

    Parameters
    ----------
    settings : MqttSettings or MqttLocalisationSettings
        The broker, and the device's topics there.
    presence_topic : str
        Topic on which this program announces itself to the device.
    topics : collection of str
        To listen to.
    """

    def __init__(
        self,
        settings: MqttSettings | MqttLocalisationSettings,
        presence_topic: str,
        topics: Collection[str],
    ) -> None:
        self._broker, self._presence_topic, self._topics = settings, presence_topic, topics
        self._reset_before_connecting()

    def __enter__(self) -> Self:
        """Connect, and wait until the device answers.

        Raises
        ------
        VehicleLinkLost
            If there is no broker, or no such device on it.
        VehicleFault
            If another program commands the device.
        """
        self._reset_before_connecting()
        self._link.connect(self._broker.connect_limit)
        self._connected = True
        try:
            self._wait_until_ready()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        """Leave the device at rest, and disconnect."""
        if self._connected:
            self._leave_at_rest()
            self._connected = False
            self._link.close()

    def _reset_before_connecting(self) -> None:
        """Know nothing of the device yet."""
        self._connected, self._paused, self._called = False, 0.0, inf
        self._events: SimpleQueue[tuple[str, str]] = SimpleQueue()
        self._session, self._number = uuid4().hex, 0
        self.dropped = 0
        """Messages that were dropped since connecting, for they were none or came out of order."""
        here, topics = PresenceMessage.at_start(self._session), self._topics
        self._link: BrokerLink = BrokerLink(
            self._broker, self._presence_topic, here, topics, self._receive, self._link_changed
        )

    def _wait_until_ready(self) -> None:
        """Wait for the first answer; raises VehicleLinkLost if none comes."""

    def _leave_at_rest(self) -> None:
        """Bring the device to rest, while the link still is there."""

    def _note_call(self) -> None:
        """Take note of a call: how long ago the caller's last one was tells who is silent."""
        now = time.monotonic()
        self._paused, self._called = now - self._called, now

    def _held_up(self, limit: float) -> str:
        """What to say of a silence of which the caller is the cause; empty if it is not."""
        if self._paused < limit:
            return ""
        return (
            f"this program was held up for {self._paused:.1f} s, and what it commands has stopped "
            "by itself. See what else this computer does, then start again."
        )

    def _deliver_events(self) -> None:
        with suppress(Empty):
            while True:
                self._listener(*self._events.get_nowait())

    def _publish(self, topic: str, kind: type[WireMessage], now: float, **fields: Any) -> None:
        """Send the next message of this session."""
        self._number += 1
        message = kind(session=self._session, number=self._number, time=now, **fields)
        self._link.publish(topic, message.to_json())

    # What the link's thread does

    def _receive(self, received: ReceivedMessage) -> None:
        try:
            self._handle_message(received)
        except BadMessage as error:
            self._note_dropped(f"on {received.topic}, number {self.dropped + 1}: {error}")

    def _note_dropped(self, sentence: str) -> None:
        self.dropped += 1
        if self.dropped in REPORTED_DROP_COUNTS:
            self._events.put(("message-dropped", sentence))

    def _handle_message(self, received: ReceivedMessage) -> None:
        """Take in a message; raises BadMessage if it is none."""

    def _link_changed(self, up: bool) -> None:
        """Take note that the link broke or is up again."""


def _send_without_delay(client: Client, data: Any, sock: Any) -> None:
    """Send small messages at once; else TCP holds them back for up to 40 ms."""
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
