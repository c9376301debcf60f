"""A torch over a broker goes where it is sent, and its arc goes out by itself."""

import pytest

from tjscan.vehicle.mqtt.link import ReceivedMessage
from tjscan.vehicle.mqtt.wire import (
    TORCH_COMMANDER_TOPIC,
    TORCH_TOPIC,
    BadMessage,
    PresenceMessage,
    TorchMessage,
    TorchStateMessage,
)
from tjscan.vehicle.vehicle import DEAD_MAN_TIME
from tjscan_loopback.vehicle.torch import AXIS_SPEED, LoopbackTorch


def send(
    torch: LoopbackTorch,
    time: float,
    *,
    y: float = 0.0,
    arc: bool = False,
    session: str = "weld",
    hold: float = DEAD_MAN_TIME,
    retained: bool = False,
) -> None:
    message = TorchMessage(
        session=session, number=round(1000 * time), time=time, y=y, z=0.0, arc=arc, hold=hold
    )
    torch.receive(ReceivedMessage(TORCH_TOPIC, message.to_json(), retained, time))


def state_at(torch: LoopbackTorch, time: float, period: float = 0.01) -> TorchStateMessage:
    return TorchStateMessage.from_json(torch.advance(time, period)[1])


def test_it_goes_where_it_is_sent_at_its_speed() -> None:
    torch = LoopbackTorch("torch")
    send(torch, 1.0, y=0.010)
    assert state_at(torch, 1.01, 0.05).y == pytest.approx(0.05 * AXIS_SPEED)
    assert state_at(torch, 1.02, 1.0).y == pytest.approx(0.010)


@pytest.mark.parametrize("hold", [0.1, DEAD_MAN_TIME, 5.0])
def test_arc_goes_out_without_a_further_message(hold: float) -> None:
    torch = LoopbackTorch("torch")
    send(torch, 1.0, arc=True, hold=hold)
    last = 1.0 + min(hold, DEAD_MAN_TIME)
    assert state_at(torch, last - 0.01).arc
    assert not state_at(torch, last).arc


def test_arc_goes_out_where_its_program_goes() -> None:
    torch = LoopbackTorch("torch")
    send(torch, 1.0, arc=True)
    gone = PresenceMessage(session="weld", number=1, time=1.1, alive=False)
    torch.receive(ReceivedMessage(TORCH_COMMANDER_TOPIC, gone.to_json(), retained=False, time=1.1))
    assert not state_at(torch, 1.11).arc


def test_what_is_old_or_of_another_program_strikes_no_arc() -> None:
    torch = LoopbackTorch("torch")
    send(torch, 1.0)
    with pytest.raises(BadMessage, match="session"):
        send(torch, 1.1, arc=True, session="other")
    with pytest.raises(BadMessage, match="kept"):
        send(torch, 1.2, arc=True, retained=True)
    with pytest.raises(BadMessage, match="number"):
        send(torch, 0.9, arc=True)
    assert not state_at(torch, 1.2).arc
