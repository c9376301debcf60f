"""The driver of vehicles behind a broker, through the real one, against loopback vehicles."""

import getpass
import json
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
import pytest
from command import tjscan

from tjscan.core.errors import (
    ConfigurationError,
    DriveFault,
    UnorderedMotion,
    VehicleFault,
    VehicleLinkLost,
    VehicleStopped,
)
from tjscan.core.frames import Array
from tjscan.vehicle.simulated_body import SimulatedBody, VehicleSimulationSettings
from tjscan.vehicle.tracks import TrackGeometry
from tjscan.vehicle.vehicle import AT_REST, DEAD_MAN_TIME, Twist, VehicleState
from tjscan_loopback.broker import MosquittoProcess, find_mosquitto
from tjscan_loopback.process import VehicleLoopbackProcess

mqtt = pytest.importorskip("tjscan.vehicle.mqtt.vehicle", reason="paho-mqtt is not installed")
pytestmark = pytest.mark.skipif(find_mosquitto() is None, reason="mosquitto is not installed")

from _stops import Break, seconds_until_rest  # noqa: E402
from paho.mqtt.client import Client  # noqa: E402
from paho.mqtt.enums import CallbackAPIVersion  # noqa: E402

from tjscan.vehicle.mqtt.link import BrokerLink, ReceivedMessage  # noqa: E402
from tjscan.vehicle.mqtt.settings import BrokerSettings, MqttSettings  # noqa: E402
from tjscan.vehicle.mqtt.torch import MqttTorch  # noqa: E402
from tjscan.vehicle.mqtt.vehicle import MqttVehicle  # noqa: E402
from tjscan.vehicle.mqtt.wire import CommandMessage, PresenceMessage, StateMessage  # noqa: E402

LONGEST = 3.0
"""Seconds: 0.6 on an idle machine, where the benchmark holds them to that."""

BROKER_FILES = {"certfile": "own.pem", "keyfile": "own-key.pem", "password_file": "users"}

SILENCE = 5.0
"""Seconds without a state that are no silence on a busy machine."""


@pytest.fixture(scope="module")
def broker() -> Iterator[MosquittoProcess]:
    with MosquittoProcess() as process:
        yield process


@pytest.fixture(scope="module")
def running(broker: MosquittoProcess) -> Iterator[VehicleLoopbackProcess]:
    with VehicleLoopbackProcess(broker.address, "--vehicles", "2") as process:
        yield process


@pytest.fixture
def vehicles(running: VehicleLoopbackProcess) -> Iterator[VehicleLoopbackProcess]:
    """Two vehicles, all right."""
    running.schedule_fault("clear")
    yield running
    running.schedule_fault("clear")


def driver(broker: MosquittoProcess, number: int = 1, **settings: float) -> MqttVehicle:
    own = {"silence_limit": SILENCE, **settings}
    return MqttVehicle(
        MqttSettings(port=broker.port, prefix=f"tjscan/vehicle/{number}", **own)  # type: ignore[arg-type]
    )


def drive(vehicle: MqttVehicle, seconds: float, twist: Twist | None = None) -> list[VehicleState]:
    """States of that time; the twist, if any, is commanded before each."""
    states, until = [], time.monotonic() + seconds
    while time.monotonic() < until:
        if twist is not None:
            vehicle.command(twist)
        states.append(vehicle.next_state())
    return states


@contextmanager
def sender(broker: MosquittoProcess) -> Iterator[Callable[..., object]]:
    """Gives what sends a command to vehicle 1 from beside its program."""
    client = Client(CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", broker.port)
    client.loop_start()
    yield lambda topic="command", **message: client.publish(
        f"tjscan/vehicle/1/{topic}", json.dumps(message)
    )
    client.disconnect()
    client.loop_stop()


def moved(vehicle: MqttVehicle, since: Array) -> float:
    return float(np.linalg.norm((vehicle.true_pose() - since)[:2, 3]))


def wait_until_it_drives(vehicle: MqttVehicle) -> None:
    """It comes back, and drives again when told to."""
    until = time.monotonic() + 10
    while True:
        try:
            drive(vehicle, 0.3, Twist(0.05, 0.0))
        except VehicleLinkLost:
            assert time.monotonic() < until
        else:
            return


def test_it_drives_as_told_and_reports_states(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    with driver(broker) as vehicle, driver(broker, 2) as other:
        assert vehicle.identity.model == "loopback crawler"
        drive(vehicle, 0.1)
        drive(other, 0.1)
        before, beside = vehicle.true_pose(), other.true_pose()
        assert beside[1, 3] - before[1, 3] == pytest.approx(1.5, abs=0.2)
        states = drive(vehicle, 1.0, Twist(0.05, 0.0))
        times = [state.time for state in states]
        assert times == sorted(set(times))
        lasted = times[-1] - times[0]
        assert 0.02 < moved(vehicle, before) < 0.05 * (lasted + DEAD_MAN_TIME)
        assert moved(other, beside) == 0.0
        assert max(state.odometry.speed for state in states) == pytest.approx(0.05, abs=2e-3)
        sampled = [state.proximity for state in states if state.proximity]
        assert 1 <= len(sampled) <= 12 * lasted
        assert np.array(sampled).max() < 0.04


def test_after_a_pause_it_reads_where_the_vehicle_is_now(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    with driver(broker) as vehicle:
        before = drive(vehicle, 0.3)[-1]
        time.sleep(0.5)  # somebody is asked something
        # Had states waited, the one behind that would come now, a hundredth of a second later.
        assert vehicle.next_state().time - before.time > 0.2


def test_the_dead_man_is_of_whoever_commands(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    with driver(broker) as vehicle:
        drive(vehicle, 0.3, Twist(0.1, 0.0))
        vehicles.unread_output()  # of rests before
        since = time.monotonic()
        drive(vehicle, 1.0)  # states are read, nothing is commanded, the driver lives
        assert vehicles.wait_until_at_rest() - since < LONGEST
        drive(vehicle, 0.2)  # the last pose has come
        stood = vehicle.true_pose()
        drive(vehicle, 0.2)
        assert moved(vehicle, stood) == 0.0


@pytest.mark.parametrize("what", Break)
def test_nothing_moves_after_something_broke(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess, what: Break
) -> None:
    assert seconds_until_rest(what, broker, vehicles) < LONGEST


def test_a_stop_holds_until_it_is_taken_back(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    with driver(broker) as vehicle:
        drive(vehicle, 0.3, Twist(0.1, 0.0))
        vehicles.unread_output()  # of rests before
        since = time.monotonic()
        thread = threading.Thread(target=vehicle.stop)
        thread.start()
        thread.join()
        assert vehicles.wait_until_at_rest() - since < DEAD_MAN_TIME
        with pytest.raises(VehicleStopped):
            vehicle.command(Twist(0.1, 0.0))
        drive(vehicle, 0.2)  # the last pose has come
        stood = vehicle.true_pose()
        drive(vehicle, 0.2)
        assert moved(vehicle, stood) == 0.0
        vehicle.accept_commands_again()
        drive(vehicle, 0.3, Twist(0.1, 0.0))
        assert moved(vehicle, stood) > 5e-3


@pytest.mark.parametrize("fault", ["freeze", "stale", "nan", "drop-link"])
def test_a_vehicle_that_is_not_heard_of_is_lost(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess, fault: str
) -> None:
    events: list[tuple[str, str]] = []
    with driver(broker, silence_limit=1.0) as vehicle:
        vehicle.report_events_to(lambda name, sentence: events.append((name, sentence)))
        drive(vehicle, 0.3, Twist(0.05, 0.0))
        vehicles.schedule_fault(f"{fault} 1")  # reads what was printed before
        with pytest.raises(VehicleLinkLost):
            drive(vehicle, 3.0, Twist(0.05, 0.0))
        with pytest.raises(VehicleLinkLost):
            vehicle.command(Twist(0.05, 0.0))
        vehicles.wait_until_at_rest()
        assert (vehicle.dropped > 0) == (fault in ("stale", "nan"))
        assert {name for name, _ in events} <= {"message-dropped", "link-lost"}
        assert bool(events) == (fault != "freeze")
        vehicles.schedule_fault("clear")
        wait_until_it_drives(vehicle)


def test_a_broker_that_is_started_again_is_used_again_when_told_to(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    with driver(broker) as vehicle:
        drive(vehicle, 0.3, Twist(0.05, 0.0))
        vehicles.unread_output()
        broker.kill()
        with pytest.raises(VehicleLinkLost):
            drive(vehicle, 3.0, Twist(0.05, 0.0))
        vehicles.wait_until_at_rest()
        broker.start()
        time.sleep(1.5)  # both ends are back
        assert not any(line.startswith("moving") for line in vehicles.unread_output())
        wait_until_it_drives(vehicle)


def test_a_fault_of_the_drives_stands_in_the_state_and_refuses_commands(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    with driver(broker) as vehicle:
        vehicles.schedule_fault("drive-fault 1")
        assert drive(vehicle, 0.2)[-1].fault
        with pytest.raises(DriveFault, match="over temperature"):
            vehicle.command(Twist(0.1, 0.0))


def test_an_edge_is_reported_and_spinning_tracks_are_not(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    with driver(broker) as vehicle:
        vehicles.schedule_fault("edge 1")
        read = [state.proximity for state in drive(vehicle, 0.4) if state.proximity]
        assert read[-1][:2] == (inf, inf)
        assert max(read[-1][2:]) < 0.04
        vehicles.schedule_fault("slip 1")
        before = vehicle.true_pose()
        states = drive(vehicle, 1.0, Twist(0.1, 0.0))
        times = np.array([state.time for state in states])
        shown = np.array([state.odometry.speed for state in states])[1:] @ np.diff(times)
        assert moved(vehicle, before) < 0.5 * shown


def test_one_program_commands_at_a_time(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    with driver(broker) as vehicle:
        stop, failed = threading.Event(), []

        def keep_driving() -> None:
            try:
                while not stop.is_set():
                    drive(vehicle, 0.1, Twist(0.02, 0.0))
            except VehicleFault as error:
                failed.append(error)

        thread = threading.Thread(target=keep_driving)
        thread.start()
        with pytest.raises(VehicleFault, match="another program"), driver(broker, connect_limit=1):
            pass
        stop.set()
        thread.join()
        assert not failed
    with driver(broker) as vehicle:
        drive(vehicle, 0.1, Twist(0.02, 0.0))


def test_messages_that_are_none_never_steer(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    heard: list[bytes] = []
    spy = Client(CallbackAPIVersion.VERSION2)
    spy.on_message = lambda client, data, message: heard.append(bytes(message.payload))
    spy.connect("127.0.0.1", broker.port)
    spy.subscribe("tjscan/vehicle/1/command")
    spy.loop_start()
    try:
        with driver(broker) as vehicle:
            drive(vehicle, 0.3)
            before = vehicle.true_pose()
            stop = json.loads(heard[-1])
            order = {**stop, "order": "drive", "speed": 0.1, "hold": 0.5}
            wrongs: tuple[dict[str, object], ...] = (
                {"speed": nan},
                {"speed": "0.1"},
                {"speed": 1e9},
                {"number": 0},
                {"session": "somebody"},
                {"time": stop["time"] - 10},
                {"hold": -1},
                {"order": "go"},
                {"extra": 1},
            )
            for number, wrong in enumerate(wrongs):
                ahead = {"number": stop["number"] + 1000 + number, "time": time.monotonic()}
                payload = json.dumps({**order, **ahead, **wrong})
                spy.publish("tjscan/vehicle/1/command", payload)
                spy.publish("tjscan/vehicle/1/command", payload[:-3])
            drive(vehicle, 0.5)
            assert moved(vehicle, before) == 0.0
    finally:
        spy.disconnect()
        spy.loop_stop()


def test_what_is_not_there_is_said(broker: MosquittoProcess) -> None:
    with MosquittoProcess() as gone:
        pass
    with pytest.raises(VehicleLinkLost, match="MQTT broker at"), driver(gone):
        pass
    with pytest.raises(VehicleLinkLost, match="no vehicle"), driver(broker, 9, connect_limit=0.3):
        pass
    with pytest.raises(VehicleLinkLost, match="with"):
        driver(broker).next_state()
    with pytest.raises(ConfigurationError, match="vehicle-loopback"):
        driver(broker).true_pose()


def test_the_command_takes_a_job_and_says_what_is_wrong(
    broker: MosquittoProcess, tmp_path: Path
) -> None:
    job = tmp_path / "job.toml"
    job.write_text("[simulation.vehicle]\nstart_mm = [500, 0]\n", encoding="utf-8")
    with (
        VehicleLoopbackProcess(broker.address, "--prefix", "own", "--settings", str(job)),
        MqttVehicle(MqttSettings(port=broker.port, prefix="own/1")) as vehicle,
    ):
        drive(vehicle, 0.1)
        assert vehicle.true_pose()[0, 3] == 0.5
    job.write_text("[simulation.vehicle]\nstrat_mm = [500, 0]\n", encoding="utf-8")
    command = ("vehicle-loopback", "--broker", broker.address)
    assert tjscan(*command, "--settings", job, pictures=True) == 2
    with MosquittoProcess() as gone:
        pass
    assert tjscan("vehicle-loopback", "--broker", gone.address, pictures=True) == 4


@pytest.mark.parametrize(
    "message",
    [
        {"session": "a stop button", "number": 0, "time": 1e9, "order": "stop"},
        {"topic": "stop", "session": "a stop button", "number": 0, "time": 1e9, "order": "stop"},
        {"topic": "stop"},
    ],
)
def test_a_stop_of_another_client_is_obeyed_and_ends_the_program_by_name(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess, message: dict[str, Any]
) -> None:
    with driver(broker) as vehicle, sender(broker) as send:
        while drive(vehicle, 0.1, Twist(0.05, 0.0))[-1].odometry.speed < 0.02:
            pass  # another stop may hold it yet
        send(**message)
        with pytest.raises(UnorderedMotion, match="another client"):
            drive(vehicle, LONGEST, Twist(0.05, 0.0))
        vehicles.wait_until_at_rest()


def test_a_programs_own_stop_is_no_alarm_whichever_topic_comes_first() -> None:
    """A broker keeps the order of each topic's messages, not of two topics'."""
    vehicle = MqttVehicle(MqttSettings(host="127.0.0.1", prefix="tjscan/vehicle/1"))
    vehicle._has_commanded, vehicle._number = True, 2
    for number, topic in ((2, "command"), (1, "stop"), (1, "stop")):
        assert not vehicle._alarm
        now = time.monotonic()
        stop = CommandMessage(
            session=vehicle._session,
            number=number,
            time=now,
            order="stop",
            speed=0.0,
            turn_rate=0.0,
            sideways=0.0,
            hold=0.0,
        )
        vehicle._receive(ReceivedMessage(topic, stop.to_json(), retained=False, time=now))
    assert "ordered the vehicle to stop" in vehicle._alarm  # a copy is another's


@pytest.mark.parametrize(
    ("hears_others", "why"), [(True, "in this program's name"), (False, "did not order")]
)
def test_motion_that_was_not_ordered_is_an_alarm_and_stopped(
    broker: MosquittoProcess,
    vehicles: VehicleLoopbackProcess,
    monkeypatch: pytest.MonkeyPatch,
    hears_others: bool,
    why: str,
) -> None:
    if not hears_others:
        monkeypatch.setattr(MqttVehicle, "_receive_order", lambda self, received: None)
    with driver(broker) as vehicle, sender(broker) as send:
        drive(vehicle, DEAD_MAN_TIME)
        # Its own repeats would stop the vehicle again before it moves at all.
        monkeypatch.setattr("tjscan.vehicle.mqtt.vehicle.ORDER_REPEAT_PERIOD", LONGEST)
        vehicles.unread_output()
        drives = {"session": vehicle._session, "order": "drive", "speed": 0.3, "hold": 0.5}

        def be_driven() -> None:
            for number in range(vehicle._number + 100, vehicle._number + 1000):
                send(**drives, number=number, time=time.monotonic() + 0.2)
                vehicle.next_state()

        with pytest.raises(UnorderedMotion, match=why):
            be_driven()
        if not hears_others:  # else it was stopped before it moved
            vehicles.wait_until_at_rest()
        with pytest.raises(UnorderedMotion):
            vehicle.command(Twist(0.05, 0.0))


def test_no_command_waits_before_a_stop(broker: MosquittoProcess) -> None:
    from tjscan_loopback.vehicle.bodies import CrawlerBody
    from tjscan_loopback.vehicle.serve import _linked
    from tjscan_loopback.vehicle.vehicle import LoopbackVehicle

    body = CrawlerBody(SimulatedBody(TrackGeometry(), VehicleSimulationSettings()))
    listening = LoopbackVehicle(1, body, "itself", print)
    settings = BrokerSettings(port=broker.port, prefix="tjscan/vehicle/flooded")
    flooded, read = threading.Event(), threading.Event()

    def hold_up(received: ReceivedMessage) -> None:
        flooded.set()
        read.wait()

    with _linked(listening, settings, "stand-in") as ((other, stops), (commands, _)):
        commands.receive = hold_up
        commands.publish("command", b"of a flood")
        assert flooded.wait(SILENCE)
        try:
            other.publish("stop", b"")
            assert stops.get(timeout=SILENCE).topic == "stop"
        finally:
            read.set()


def test_a_stop_is_sent_where_no_command_waits(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    heard: SimpleQueue[bytes] = SimpleQueue()
    settings = BrokerSettings(port=broker.port, prefix="tjscan/vehicle/1")
    presence = PresenceMessage.at_start("listener")
    link = BrokerLink(settings, "listener", presence, ("stop",), lambda one: heard.put(one.payload))
    link.connect(SILENCE)
    with driver(broker) as vehicle:
        drive(vehicle, 0.3, Twist(0.05, 0.0))
        vehicle.stop()
        order = CommandMessage.from_json(heard.get(timeout=SILENCE))
        assert (order.session, order.order) == (vehicle._session, "stop")
    link.close()


def test_who_waits_for_a_vehicle_takes_it_over_from_who_stops_and_goes(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    first = driver(broker).__enter__()
    with ThreadPoolExecutor(1) as pool:
        taken = pool.submit(driver(broker, connect_limit=SILENCE).__enter__)
        drive(first, 1.0, Twist(0.05, 0.0))
        first.__exit__()
        with taken.result() as second:
            drive(second, 0.3, Twist(0.05, 0.0))


def state_message(vehicle: MqttVehicle, number: int, speed: float) -> StateMessage:
    """The state of a vehicle that takes this program's commands, a hundredth of a second later."""
    state = VehicleState(0.01 * number, Twist(speed, 0.0))
    own = {"session": "vehicle", "commander": vehicle._session}
    return StateMessage.of_state(state, number=number, time=0.01 * number, **own)


def test_states_that_are_read_while_they_are_counted_hold_nothing_up() -> None:
    class ReadMeanwhile(SimpleQueue[Any]):
        def qsize(self) -> int:
            return 10**6

    vehicle = MqttVehicle(MqttSettings())
    vehicle._gate.session, vehicle._states = "vehicle", ReadMeanwhile()
    thread = threading.Thread(
        target=vehicle._receive_state, args=(state_message(vehicle, 1, 0.0), 0.01), daemon=True
    )
    thread.start()
    thread.join(LONGEST)
    assert not thread.is_alive()


def test_numbers_and_clocks_of_the_future_lock_nobody_out(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess
) -> None:
    with driver(broker) as vehicle, sender(broker) as send:
        states = drive(vehicle, 0.3, Twist(0.05, 0.0))
        for number, later in ((2**53, 0.0), (vehicle._number + 10, 100.0)):
            drives = {"order": "drive", "speed": 0.3, "hold": 0.5}
            send(session=vehicle._session, number=number, time=time.monotonic() + later, **drives)
        states = drive(vehicle, 2 * DEAD_MAN_TIME, Twist(0.05, 0.0))
        assert states[-1].odometry.speed == pytest.approx(0.05, abs=2e-3)


def test_a_program_that_was_held_up_says_so(
    broker: MosquittoProcess, vehicles: VehicleLoopbackProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        driver(broker, silence_limit=0.5) as vehicle,
        MqttTorch(vehicle.settings, reach=0.1) as torch,
    ):
        drive(vehicle, 0.1)
        torch.move(0.0, 0.0, 0.01)
        before, monotonic = time.monotonic(), time.monotonic
        # As a frozen process wakes: before its threads took what has arrived.
        vehicle._heard = torch._heard = before
        for device in (vehicle, torch):
            device._link.receive = lambda received: None
        monkeypatch.setattr(time, "monotonic", lambda: monotonic() + 1.0)
        for call in (lambda: torch.move(0.0, 0.0, 0.01), lambda: vehicle.command(AT_REST)):
            with pytest.raises(VehicleLinkLost, match="held up for 1"):
                call()


# Where a broker does not prove itself, paho leaves its socket to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_broker_may_want_a_password_and_prove_itself(tmp_path: Path) -> None:
    def run(*command: str) -> None:
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)

    new = ("-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=127.0.0.1")
    for name in ("own", "other"):
        files = ("-keyout", f"{name}-key.pem", "-out", f"{name}.pem")
        run("openssl", "req", "-x509", *new, *files, "-addext", "subjectAltName=IP:127.0.0.1")
    run("mosquitto_passwd", "-b", "-c", "users", "welder", "secret")
    (tmp_path / "password").write_text("secret\n", encoding="utf-8")
    (tmp_path / "wrong").write_text("other\n", encoding="utf-8")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        secure = probe.getsockname()[1]
    lines = (
        f"user {getpass.getuser()}",  # a broker of root's gives up its rights
        f"listener {secure} 127.0.0.1",
        "allow_anonymous false",
        *(f"{what} {tmp_path}/{file}" for what, file in BROKER_FILES.items()),
    )
    with MosquittoProcess(*lines) as broker, VehicleLoopbackProcess(broker.address):
        right = replace(
            MqttSettings(port=secure, user="welder", connect_limit=LONGEST),
            password_file=str(tmp_path / "password"),
            ca_file=str(tmp_path / "own.pem"),
        )
        with MqttVehicle(right) as vehicle:
            assert drive(vehicle, 0.2, Twist(0.05, 0.0))
        refusals: list[tuple[dict[str, Any], str]] = [
            ({"password_file": str(tmp_path / "wrong")}, "(?i)not authori[sz]ed"),
            ({"ca_file": ""}, "take this client|no MQTT broker"),
            ({"ca_file": str(tmp_path / "other.pem")}, "prove"),
        ]
        for wrong, why in refusals:
            with pytest.raises(VehicleLinkLost, match=why), MqttVehicle(replace(right, **wrong)):
                pass
        for key in ("password_file", "ca_file"):
            gone = replace(right, **{key: str(tmp_path / "gone")})  # type: ignore[arg-type]
            with pytest.raises(ConfigurationError, match="gone"), MqttVehicle(gone):
                pass
            with pytest.raises(ValueError, match="absolute"):
                replace(right, **{key: "beside"})  # type: ignore[arg-type]
        with pytest.raises(ValueError, match="needs user"):
            replace(right, user="")


def test_addresses_of_other_machines_and_odd_topics_are_refused() -> None:
    from tjscan_loopback.vehicle.serve import run_loopback_vehicles

    for address in ("0.0.0.0:1883", "192.168.0.1:1883", "localhost:1883", "127.0.0.1", "::1"):
        with pytest.raises(ConfigurationError):
            run_loopback_vehicles(1, address, "t", settings=None, seed=0, attached=True)
    with pytest.raises(ConfigurationError):
        run_loopback_vehicles(0, "127.0.0.1:1883", "t", settings=None, seed=0, attached=True)
    for prefix in ("a/+/b", "#", "$SYS", "/a"):
        with pytest.raises(ValueError, match="prefix"):
            replace(MqttSettings(), prefix=prefix)
