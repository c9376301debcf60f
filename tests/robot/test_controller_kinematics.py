"""A controller's own kinematic calibration: over the wire, and against the model."""

from __future__ import annotations

import socket
import struct
from threading import Thread

import arm_models
import numpy as np
import pytest
from ur_cell import address, arm_at

from tjscan.robot.closed_form import DhParameters
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.ur.kinematics_info import (
    PRIMARY_INTERFACE_PORT,
    compare_flange_with_model,
    find_kinematics_package,
    read_kinematics_info,
)
from tjscan_loopback.process import UrLoopbackProcess
from tjscan_loopback.ur.primary import (
    draw_calibration,
    kinematics_message,
    nominal_dh_parameters,
    with_dh_parameters,
)


def nominal(model: str = "ur10e") -> DhParameters:
    found = nominal_dh_parameters(model)
    assert found is not None
    return found


@pytest.mark.parametrize("model", arm_models.ARMS)
def test_the_maker_s_parameters_and_the_urdf_are_one_arm(model: str) -> None:
    _, largest = compare_flange_with_model(nominal(model), Kinematics.load(model))
    assert largest < 1e-12


def test_an_arm_of_another_make_has_no_such_parameters() -> None:
    assert nominal_dh_parameters("kr5_arc") is None


def test_an_arm_placed_by_calibrated_parameters_follows_them() -> None:
    own = draw_calibration(nominal(), 3)
    arm = with_dh_parameters(Kinematics.load("ur10e"), nominal(), own)
    q = np.random.default_rng(0).uniform(-3, 3, 6)
    np.testing.assert_allclose(arm.forward(q), own.forward(q), rtol=0, atol=1e-12)
    rms, _ = compare_flange_with_model(own, Kinematics.load("ur10e"))
    assert 1e-4 < rms < 3e-3


def test_what_is_sent_is_read_among_other_packages() -> None:
    own = draw_calibration(nominal(), 4)
    message = kinematics_message(own)
    assert struct.unpack_from(">iB", message) == (len(message), 16)
    assert len(set(struct.unpack_from(">6I", message, 10))) == 6
    body = message[5:]
    other = struct.pack(">iB", 9, 0) + b"abcd"
    for packages in (body, other + body, body + other):
        found = find_kinematics_package(packages)
        assert found is not None
        for name in ("theta", "a", "d", "alpha"):
            np.testing.assert_array_equal(getattr(found, name), getattr(own, name))


@pytest.mark.parametrize(
    "body",
    [b"", b"\x00" * 40, struct.pack(">iB", -1, 5), struct.pack(">iB", 999, 5) + b"\x00" * 50],
)
def test_what_can_not_be_is_no_calibration(body: bytes) -> None:
    assert find_kinematics_package(body) is None


def test_numbers_that_are_none_are_no_calibration() -> None:
    body = bytearray(kinematics_message(nominal())[5:])
    body[5 + 24 : 5 + 32] = struct.pack(">d", float("nan"))
    assert find_kinematics_package(bytes(body)) is None


def test_a_controller_that_is_silent_or_cut_off_states_nothing() -> None:
    host = address()
    for said in (b"", kinematics_message(nominal())[:100], b"\xff" * 300):
        with socket.create_server((host, PRIMARY_INTERFACE_PORT)) as server:

            def answer(server: socket.socket = server, said: bytes = said) -> None:
                stream, _ = server.accept()
                with stream:
                    stream.sendall(said)

            thread = Thread(target=answer)
            thread.start()
            assert read_kinematics_info(host, 1.0) is None
            thread.join()
    assert read_kinematics_info(host, 0.5) is None  # nobody listens


def test_the_driver_says_where_model_and_controller_disagree() -> None:
    pytest.importorskip("rtde_control")
    own = draw_calibration(nominal(), 7)
    rms, _ = compare_flange_with_model(own, Kinematics.load("ur10e"))
    with UrLoopbackProcess(address(), "--fast", "--calibration-seed", "7") as process:
        stated = read_kinematics_info(process.host)
        assert stated is not None
        np.testing.assert_array_equal(stated.a, own.a)
        with arm_at(process.host) as arm:
            said = str(arm.identity)
            state = arm.state()
    assert f"{1e3 * rms:.2f} mm RMS" in said
    assert "poses are the controller's" in said
    # The controller itself follows what it states.
    np.testing.assert_allclose(state.T_b_f, own.forward(state.q), rtol=0, atol=1e-5)
