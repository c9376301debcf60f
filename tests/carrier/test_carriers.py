"""Laws of carriers behind their protocol."""

from __future__ import annotations

from threading import Thread

import numpy as np
import pytest

from tjscan.carrier.carrier import ManualCarrier
from tjscan.carrier.kinematics import AxisSettings, CarrierKinematics
from tjscan.carrier.simulated import CarrierSimulationSettings, SimulatedCarrier
from tjscan.core.errors import CarrierFault
from tjscan.core.frames import rotation_angle_between

TRACK = AxisSettings(name="x", kind="linear", direction=(1.0, 0.0, 0.0), limits=(-9.0, 9.0))
KINEMATICS = CarrierKinematics((TRACK,), np.eye(4), carries_joint=False)


def test_a_stop_in_the_middle_of_a_move_brings_it_to_rest() -> None:
    slow = CarrierSimulationSettings(speed=1e-3, realtime=True)
    carrier = SimulatedCarrier(KINEMATICS, np.zeros(1), slow)
    caught = list[CarrierFault]()

    def move() -> None:
        try:
            carrier.move_to(np.array([8.0]))
        except CarrierFault as error:
            caught.append(error)

    with carrier:
        thread = Thread(target=move)
        thread.start()
        carrier.stop()
        thread.join()
        assert "stopped" in str(caught[0])
        assert 0.0 <= carrier.state()[0] < 8.0
        with pytest.raises(CarrierFault):  # that holds until it is connected again
            carrier.move_to(np.array([1.0]))


def test_where_it_stops_differs_by_what_is_stated_and_is_the_same_at_the_same_stop() -> None:
    table = CarrierSimulationSettings(error=3e-4, angular_error=1e-3)
    stops = np.linspace(-8, 8, 400)[:, None]
    true = [table.true_T_w_b(KINEMATICS, stop, 1) for stop in stops]
    off = [T[:3, 3] - KINEMATICS.T_w_b(v)[:3, 3] for T, v in zip(true, stops, strict=True)]
    assert np.sqrt(np.mean(np.square(off)) * 3) == pytest.approx(3e-4, rel=0.1)
    turned = [rotation_angle_between(T, np.eye(4)) for T in true]
    assert np.sqrt(np.mean(np.square(turned))) == pytest.approx(1e-3, rel=0.1)
    np.testing.assert_array_equal(table.true_T_w_b(KINEMATICS, stops[7], 1), true[7])


def test_who_does_not_move_it_ends_the_run() -> None:
    asked = list[str]()

    def ask(text: str) -> bool:
        asked.append(text)
        return len(asked) <= 2

    with ManualCarrier(KINEMATICS, np.zeros(1), ask) as carrier:
        assert carrier.move_to(np.array([1.2])) == 1.2
        with pytest.raises(CarrierFault, match="not moved to x 2000 mm by hand"):
            carrier.move_to(np.array([2.0]))
        assert carrier.state() == 1.2
    assert "Is the carrier at x 0 mm" in asked[0]
    assert "x 1200 mm" in asked[1]
    with pytest.raises(CarrierFault, match="is not at x 0 mm"):
        ManualCarrier(KINEMATICS, np.zeros(1), ask).__enter__()
