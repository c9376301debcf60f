"""Laws of a carrier that sways, and of moves that are shaped for it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tjscan.core.errors import ConfigurationError
from tjscan.core.frames import Array, pose
from tjscan.robot.kinematics import Kinematics
from tjscan.robot.path import MotionLimits, PathPlanner
from tjscan.robot.settings import InputShaper, SwayMode, SwaySettings
from tjscan.robot.simulated import SimulatedArm
from tjscan.robot.sway import SimulatedSway

WELL = np.radians([10, -80, 100, -60, -80, 20])
ROUNDING = 1e-12
"""Metres."""


@cache
def kinematics(model: str = "ur10e") -> Kinematics:
    return Kinematics.load(model)


def mode(frequency: float = 4.0, damping: float = 0.02, **other: object) -> SwayMode:
    stated: dict[str, object] = {"direction": (0.0, 1.0, 0.0), "mass": 300.0} | other
    return SwayMode(frequency=frequency, damping=damping, **stated)  # type: ignore[arg-type]


def swaying(*modes: SwayMode, seed: int = 1) -> SimulatedSway:
    return SimulatedSway(SwaySettings(mode=modes or (mode(),)), np.random.default_rng(seed))


def kicked(sway: SimulatedSway, impulse: float = -3.0) -> SimulatedSway:
    """The same, just after its base was pushed along y, in kg m/s."""
    sway.advance(0.0, np.array((0, -impulse, 0, 0, 0, 0)))
    sway.advance(0.0, np.array((0, -impulse, 0, 0, 0, 0)))
    return sway


@given(st.floats(2, 8), st.floats(0.01, 0.05), st.floats(0.0, 3.0))
def test_a_kick_decays_with_the_frequency_and_damping_that_are_stated(
    frequency: float, damping: float, seconds: float
) -> None:
    sway = kicked(swaying(mode(frequency, damping)), 3.0)
    held = np.array((0, -3.0, 0, 0, 0, 0))  # the arm moves on evenly: it does not push any more
    sway.advance(seconds, held)
    w = 2 * np.pi * frequency
    fast = w * np.sqrt(1 - damping**2)
    told = 3.0 / 300.0 / fast * np.exp(-damping * w * seconds) * np.sin(fast * seconds)
    assert sway.displacements[0] == pytest.approx(told, abs=ROUNDING)


@given(st.lists(st.floats(0.001, 0.2), min_size=2, max_size=6))
def test_its_steps_are_exact_however_time_is_cut(steps: list[float]) -> None:
    cut, whole = (kicked(swaying(mode(), mode(7.0))) for _ in range(2))
    held = np.array((0, 3.0, 0, 0, 0, 0))
    for seconds in steps:
        cut.advance(seconds, held)
    whole.advance(sum(steps), held)
    np.testing.assert_allclose(cut.displacements, whole.displacements, rtol=0, atol=ROUNDING)


@given(st.floats(2, 8), st.floats(0.01, 0.05))
def test_its_energy_never_grows_without_a_force(frequency: float, damping: float) -> None:
    sway, w, moment = kicked(swaying(mode(frequency, damping))), 2 * np.pi * frequency, 1e-6
    held = np.array((0, 3.0, 0, 0, 0, 0))
    energies = []
    for _ in range(40):
        before = sway.displacements[0]
        sway.advance(moment, held)
        speed = (sway.displacements[0] - before) / moment
        energies.append(speed**2 + (w * before) ** 2)
        sway.advance(0.013, held)
    assert np.all(np.diff(energies) < 1e-3 * energies[0])
    assert energies[-1] < energies[0]


def test_a_pushed_base_moves_as_an_integrator_of_another_make_has_it() -> None:
    sway, w = swaying(mode(3.0, 0.03)), 2 * np.pi * 3.0

    def momentum(t: float) -> float:
        return float(2.0 * np.sin(np.pi * min(t, 1.0)) ** 2)

    def law(t: float, x: Array) -> tuple[float, float]:
        force = -(momentum(t + 1e-6) - momentum(t - 1e-6)) / 2e-6
        return x[1], force / 300.0 - 2 * 0.03 * w * x[1] - w**2 * x[0]

    tick = 0.002
    for k in range(600):
        sway.advance(tick, np.array((0, momentum((k + 0.5) * tick), 0, 0, 0, 0)))
    told = solve_ivp(law, (0, 1.2), (0.0, 0.0), rtol=1e-9, atol=1e-12, max_step=0.01).y[0, -1]
    assert sway.displacements[0] == pytest.approx(told, abs=2e-6)


def test_wind_keeps_up_the_displacement_that_is_stated() -> None:
    sway = swaying(mode(4.0, 0.05, wind=2e-4))
    found = []
    for _ in range(20_000):
        sway.advance(0.05)
        found.append(sway.displacements[0])
    # About 1000 independent values: their root mean square is known to 2 %.
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(2e-4, rel=0.1)


def test_a_base_that_turns_about_a_pivot_leaves_the_pivot_where_it_is() -> None:
    one = mode(pivot=(0.3, 0.0, 2.0), direction=(0.0, 1.0, 0.2))
    twist = one.twist
    assert np.linalg.norm(twist[:3]) == pytest.approx(1.0)
    np.testing.assert_allclose(twist[:3] + np.cross(twist[3:], (0.3, 0.0, 2.0)), 0, atol=1e-12)
    with pytest.raises(ValueError, match="direction"):
        mode(pivot=(0.0, 1.0, 0.0))


@pytest.mark.parametrize("model", ["ur10e", "kr5_arc"])
def test_the_momentum_of_an_arm_is_that_of_its_masses(model: str) -> None:
    arm, v = kinematics(model), np.array((0.3, -0.2, 0.4, 0.1, -0.5, 0.2))
    alone, loaded = (arm.momentum(WELL, v, payload) for payload in (0.0, 5.0))
    carried = 5.0 * arm.jacobian(WELL)[:3] @ v
    p_b_f = arm.forward(WELL)[:3, 3]
    np.testing.assert_allclose(
        loaded - alone, np.concatenate((carried, np.cross(p_b_f, carried))), atol=1e-9
    )
    # The maker of the one states its masses, of the other not.
    assert (np.linalg.norm(alone[:3]) > 0.5) == (model == "ur10e")


def test_momentum_is_mass_times_speed_of_the_centre() -> None:
    import pinocchio as pin

    arm, v = kinematics(), np.array((0.3, -0.2, 0.4, 0.1, -0.5, 0.2))
    data = arm.model.createData()
    moment = 1e-6
    before, after = (
        np.array(pin.centerOfMass(arm.model, data, WELL + t * v)) for t in (-moment, moment)
    )
    mass = pin.computeTotalMass(arm.model)
    told = mass * np.linalg.inv(arm.T_root_b)[:3, :3] @ (after - before) / (2 * moment)
    np.testing.assert_allclose(arm.momentum(WELL, v)[:3], told, atol=1e-5)


def move_of(arm: SimulatedArm, x: float) -> None:
    T_b_f = kinematics().forward(WELL)
    arm.move_linear(pose(T_b_f[:3, :3], T_b_f[:3, 3] + [0, x, 0]))


def residual(frequency: float, shaper: InputShaper | None) -> float:
    """Largest displacement in the second after a move of 60 mm, metres."""
    arm = SimulatedArm(kinematics(), WELL, limits=MotionLimits(shaper=shaper))
    arm.sway = swaying(mode(frequency, 0.02))
    with arm:
        move_of(arm, 0.06)
        found = []
        for _ in range(200):
            arm.pass_time(0.005)
            found.append(abs(arm.sway.displacements[0]))
    return float(max(found))


def test_the_true_pose_sways_after_a_move_and_the_reported_one_does_not() -> None:
    arm = SimulatedArm(kinematics(), WELL, repeatability=(0, 0))
    arm.sway = swaying(mode(mass=20.0))
    with arm:
        move_of(arm, 0.06)
        still = arm.state().T_b_f
        ways = []
        for _ in range(50):
            arm.pass_time(0.01)
            np.testing.assert_array_equal(arm.state().T_b_f, still)
            ways.append(arm.true_T_b_f[:3, 3] - still[:3, 3])
    assert np.ptp(np.array(ways)[:, 1]) > 1e-4
    assert np.abs(np.array(ways)[:, [0, 2]]).max() < 1e-8


@pytest.mark.parametrize("off", [0.9, 1.0, 1.1])
@pytest.mark.parametrize("frequency", [2.0, 4.0, 8.0])
def test_a_shaped_move_leaves_a_twentieth_of_the_sway(frequency: float, off: float) -> None:
    plain = residual(frequency, None)
    shaped = residual(frequency, InputShaper(frequency=off * frequency, damping=0.02))
    assert shaped < 0.05 * plain


def test_a_shaped_move_keeps_its_path_and_its_limits() -> None:
    shaper = InputShaper(frequency=3.0)
    T = kinematics().forward(WELL)
    T = pose(T[:3, :3], T[:3, 3] + [0, 0.06, 0])
    plain, shaped = (
        PathPlanner(kinematics(), MotionLimits(shaper=one)).linear_path(WELL, T)
        for one in (None, shaper)
    )
    np.testing.assert_array_equal(plain.q, shaped.q)
    assert shaped.duration == pytest.approx(plain.duration + 1 / 3.0, rel=1e-3)
    np.testing.assert_allclose(shaped.joint_angles_at(0.0), plain.q[0], atol=1e-12)
    np.testing.assert_allclose(shaped.joint_angles_at(shaped.duration), plain.q[-1], atol=1e-12)
    times = np.linspace(0, shaped.duration, 2000)
    p = np.array([kinematics().forward(q)[:3, 3] for q in shaped.joint_angles_at(times)])
    away = p - p[0]
    assert np.abs(away[:, [0, 2]]).max() < 1e-5
    speeds = np.diff(away[:, 1]) / np.diff(times)
    assert speeds.min() > -1e-6
    assert speeds.max() < 0.25 * 1.001
    assert np.abs(np.diff(speeds) / np.diff(times)[1:]).max() < 1.2 * 1.01


def test_an_arm_whose_controller_times_its_moves_takes_no_shaper() -> None:
    from tjscan.robot.drivers import ARM_DRIVERS, ArmDriverInputs
    from tjscan.robot.ur.settings import UrSettings

    limits = MotionLimits(shaper=InputShaper(frequency=3.0))
    inputs = ArmDriverInputs(kinematics(), limits, 1, None, None, lambda: ([], ()))  # type: ignore[arg-type, return-value]
    with pytest.raises(ConfigurationError, match="times its moves itself"):
        ARM_DRIVERS.load("ur").make(inputs, UrSettings("127.0.0.1"))
