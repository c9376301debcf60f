"""Run loopback vehicles as this process."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Final
from uuid import uuid4

from tjscan.core.config import read_toml, validate_table
from tjscan.core.errors import ConfigurationError, VehicleLinkLost
from tjscan.core.signals import survive_background_terminal_read
from tjscan.vehicle.mqtt.link import BrokerLink, ReceivedMessage
from tjscan.vehicle.mqtt.settings import BrokerSettings
from tjscan.vehicle.mqtt.wire import (
    COMMAND_TOPIC,
    COMMANDER_TOPIC,
    PRESENCE_TOPIC,
    STOP_TOPIC,
    TORCH_COMMANDER_TOPIC,
    TORCH_TOPIC,
    PresenceMessage,
)
from tjscan.vehicle.simulated_body import (
    VEHICLE_STATE_PERIOD,
    SimulatedBody,
    VehicleSimulationSettings,
)
from tjscan.vehicle.tracks import TrackGeometry
from tjscan_loopback.process import TRUTH_COMMAND, parse_loopback_port, print_line
from tjscan_loopback.vehicle.bodies import CrawlerBody, LoopbackBody
from tjscan_loopback.vehicle.faults import VehicleFaultOrder, parse_ordered_fault
from tjscan_loopback.vehicle.towing import TowingBodies
from tjscan_loopback.vehicle.vehicle import LoopbackVehicle

CONNECT_LIMIT: Final = 5.0
"""Seconds that a connection to a broker on this machine may take."""

LONGEST_PERIOD: Final = 0.1
"""Seconds of motion in one step; if the process slept longer, the rest of its sleep is lost."""

STOP_LINK_TOPIC: Final = "stop-link"
"""Topic on which the connection of its own that hears stops announces itself."""

COMMAND_LINK_TOPICS: Final = (COMMAND_TOPIC, COMMANDER_TOPIC, TORCH_TOPIC, TORCH_COMMANDER_TOPIC)

VEHICLE_SPACING: Final = 1.5
"""Metres from one vehicle to the next, along y of frame w."""

MOST_VEHICLES: Final = 50


def run_loopback_vehicles(
    vehicles: int,
    broker: str,
    prefix: str,
    *,
    settings: Path | None,
    seed: int,
    attached: bool,
    towing: TowingBodies | None = None,
) -> None:
    """Run vehicles until interrupted, or until an attached stdin ends.

    They print their events to stdout, a line each. They are crawlers side by side, or those of a
    towing world, which counts them.

    Raises
    ------
    ConfigurationError
        If the number of vehicles, the broker's address or the settings can't be.
    VehicleLinkLost
        If there is no broker.
    """
    if not 1 <= vehicles <= MOST_VEHICLES:
        raise ConfigurationError(f"1 to {MOST_VEHICLES} (found {vehicles})", key="vehicles")
    host, port = parse_loopback_port(broker, key="broker")
    bodies: list[LoopbackBody] = []
    if towing is not None:
        bodies += towing.bodies
        if vehicles != len(bodies):
            raise ConfigurationError(
                f"the job has {len(bodies)} vehicles (found {vehicles})", key="vehicles"
            )
    else:
        bodies += _crawlers(vehicles, settings, seed)
    survive_background_terminal_read()
    with ExitStack() as stack:
        served = []
        for number, body in enumerate(bodies, 1):
            vehicle = LoopbackVehicle(number, body, uuid4().hex, print_line)
            model = "loopback crawler" if towing is None else "loopback towing vehicle"
            own = BrokerSettings(host=host, port=port, prefix=f"{prefix}/{number}")
            links = stack.enter_context(_linked(vehicle, own, model))
            served.append((vehicle, links))
        world = None
        if towing is not None:
            tracker = towing.link(host, port, prefix)
            tracker.connect(CONNECT_LIMIT)
            stack.callback(tracker.close)
            world = (towing, tracker)
        print_line(f"ready {host}:{port} {prefix}")
        orders: SimpleQueue[str | None] = SimpleQueue()
        Thread(target=_listen, args=(orders,), daemon=True).start()
        _run(served, world, orders, attached=attached)


Inbox = SimpleQueue[ReceivedMessage]
Links = list[tuple[BrokerLink, Inbox]]
Served = tuple[LoopbackVehicle, Links]


@contextmanager
def _linked(vehicle: LoopbackVehicle, settings: BrokerSettings, model: str) -> Iterator[Links]:
    """Connect a vehicle, twice: what floods its commands is in no stop's way.

    The messages of each link wait in its inbox until the vehicle looks there, stops first.
    """
    links: Links = []
    with ExitStack() as stack:
        for session, presence_topic, topics in (
            (f"{vehicle.session}-stop", STOP_LINK_TOPIC, (STOP_TOPIC,)),
            (vehicle.session, PRESENCE_TOPIC, COMMAND_LINK_TOPICS),
        ):
            inbox: Inbox = SimpleQueue()
            presence = PresenceMessage.at_start(session, model, str(vehicle.number))
            link = BrokerLink(settings, presence_topic, presence, topics, inbox.put)
            link.connect(CONNECT_LIMIT)
            stack.callback(link.close)
            links.append((link, inbox))
        yield links


def _run(
    served: list[Served],
    world: tuple[TowingBodies, BrokerLink] | None,
    orders: SimpleQueue[str | None],
    *,
    attached: bool,
) -> None:
    before = due = time.monotonic()
    while True:
        due = max(
            due + VEHICLE_STATE_PERIOD, time.monotonic()
        )  # a process that was held up does not hurry
        time.sleep(due - min(time.monotonic(), due))
        while not orders.empty():
            line = orders.get()
            if line is not None:
                _obey(line, served, None if world is None else world[0])
            elif attached:
                return
        now = time.monotonic()
        period, before = min(now - before, LONGEST_PERIOD), now
        for vehicle, links in served:
            for _, inbox in links:
                for _ in range(inbox.qsize()):  # what comes meanwhile may come without end
                    vehicle.receive(inbox.get())
            vehicle.link_is_up = all(link.is_up for link, _ in links)
            for topic, payload in vehicle.advance(now, period):
                links[-1][0].publish(topic, payload)
        if world is not None:
            towing, tracker = world
            towing.advance(period)
            for touch in towing.look_at_truth():
                print_line(f"touched {touch}")
            for topic, payload in towing.sightings(now):
                tracker.publish(topic, payload)


def _obey(line: str, served: list[Served], towing: TowingBodies | None) -> None:
    if towing is not None and line.strip() == TRUTH_COMMAND:
        print_line(f"{TRUTH_COMMAND} {towing.truth_as_json()}")
        return
    try:
        order = parse_ordered_fault(line, len(served))
    except ConfigurationError as error:
        print_line(f"refused {error}")
        return
    if order.fault not in served[0][0].body.possible_faults:
        print_line(f"refused these vehicles can't have the fault {order.fault}")
        return
    if towing is not None and order.fault is VehicleFaultOrder.PASSER_STANDS:
        towing.hold_passers_by(True)
    if towing is not None and order.fault is VehicleFaultOrder.CLEAR:
        towing.hold_passers_by(False)
    for vehicle, links in served:
        if order.vehicle in (0, vehicle.number):
            cut = VehicleFaultOrder.DROP_LINK in vehicle.faults
            if order.fault is VehicleFaultOrder.DROP_LINK and not cut:
                _drop(links)
            elif order.fault is VehicleFaultOrder.CLEAR and cut:
                try:
                    _connect_again(links)
                except VehicleLinkLost as error:
                    print_line(f"refused {error}")
                    return
            vehicle.order_fault(order.fault)
    print_line(f"ordered {line.strip()}")


def _drop(links: Links) -> None:
    for link, _ in links:
        link.drop()


def _connect_again(links: Links) -> None:
    for link, _ in links:
        link.connect(CONNECT_LIMIT)


def _listen(orders: SimpleQueue[str | None]) -> None:
    # A thread, for stdin may be a terminal, a pipe, a file or nothing at all.
    with suppress(OSError, ValueError):
        for line in sys.stdin:
            orders.put(line)
    orders.put(None)


def _crawlers(vehicles: int, settings: Path | None, seed: int) -> Iterator[CrawlerBody]:
    """Crawlers beside each other, as the job has them."""
    tracks, simulation = _read_settings(settings)
    x, y = simulation.start
    for number in range(vehicles):
        own = replace(simulation, start=(x, y + VEHICLE_SPACING * number))
        yield CrawlerBody(SimulatedBody(tracks, own, seed=seed + number))


def _read_settings(file: Path | None) -> tuple[TrackGeometry, VehicleSimulationSettings]:
    """[vehicle.tracks] and [simulation.vehicle] of a job; what it lacks has its default."""
    job = {} if file is None else read_toml(file)
    return (
        validate_table(TrackGeometry, _table(job, "vehicle", "tracks"), file),
        validate_table(VehicleSimulationSettings, _table(job, "simulation", "vehicle"), file),
    )


def _table(job: dict[str, object], outer: str, inner: str) -> dict[str, object]:
    table = job.get(outer, {})
    found = table.get(inner, {}) if isinstance(table, dict) else {}
    return found if isinstance(found, dict) else {}
