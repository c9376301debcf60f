"""URScript on the loopback controller: what its words do, and how programs end that can't go on."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pytransform3d import rotations as pr
from pytransform3d import transformations as pt
from ur_cell import HOME, KINEMATICS

from tjscan.core import pose_vector
from tjscan.core.frames import Array
from tjscan_loopback.ur.controller import LoopbackController
from tjscan_loopback.ur.urscript.compile import compile_program
from tjscan_loopback.ur.urscript.incoming import IncomingScripts
from tjscan_loopback.ur.urscript.tokens import ScriptError

HZ = 125.0


class Bench:
    """A controller without a network, its ticks counted by hand."""

    def __init__(self) -> None:
        self.told: list[str] = []
        self.controller = LoopbackController(
            KINEMATICS, HOME, hz=HZ, fast=False, report_line=self.told.append
        )
        self.poses: list[Array] = []
        self.outputs: list[int] = []

    def run(self, *lines: str, most: int = 4000) -> None:
        """Run a program to its end, and note pose and outputs of every tick."""
        self.controller.start_script("\n".join(["def test():", *lines, "end", ""]))
        for _ in range(most):
            self.controller.advance_one_tick()
            self.poses.append(KINEMATICS.forward(self.controller.q))
            self.outputs.append(self.controller.digital_outputs)
            if self.told[-1] == "program stopped":
                return
        raise AssertionError("the program does not end")

    @property
    def failure(self) -> str:
        return next((line for line in self.told if line.startswith("program failed")), "")

    def value(self, expression: str, *before: str) -> float:
        """Value of an expression, through an output register."""
        self.run(*before, f"write_output_float_register(3, {expression})")
        assert not self.failure
        return self.controller.output_double[3]


def written(T: Array) -> str:
    return f"p[{', '.join(repr(float(x)) for x in pose_vector.pose_to_vector(T))}]"


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1 + 2 * 3 - 4 / 8", 6.5),
        ("-2 * (3 - 5)", 4.0),
        ("7 % 4 + 0x10", 19.0),
        ("1.5e1 + .5", 15.5),
        ("[1, 2, 3][1] + p[0, 0, 0.25, 0, 0, 0][2]", 2.25),
        ("sqrt(norm([3, 4]) * 5)", 5.0),
        ("sin(d2r(30)) + atan2(0, 1)", math.sin(math.radians(30))),
        ("length([1, 2])", 2.0),
        ("point_dist(p[0, 0, 0, 0, 0, 0], p[0, 3, 4, 0, 0, 0])", 5.0),
    ],
)
def test_expressions_have_the_value_that_arithmetic_gives_them(
    expression: str, value: float
) -> None:
    assert Bench().value(expression) == pytest.approx(value)


VARIABLES = """
global n = 0
def count(step):
    n = n + step
    local n = 100
    return n
end
thread adding():
    while True:
        n = n + 1
        sync()
    end
end
k = 0
while k < 4:
    k = k + 1
    if k == 2:
        continue
    elif k == 4 or not (k < 4):
        break
    else:
        count(10)
    end
end
"""


def test_functions_change_the_programs_variables_and_keep_their_own() -> None:
    assert Bench().value("n", *VARIABLES.splitlines()) == 20


def test_a_thread_runs_once_a_tick_until_it_is_killed() -> None:
    lines = [*VARIABLES.splitlines(), "n = 0", "t = run adding()", "sleep(0.08)", "kill t"]
    assert Bench().value("n", *lines, "sleep(0.08)") == pytest.approx(10, abs=1)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-1.5, 1.5), min_size=12, max_size=12))
def test_poses_multiply_as_another_library_has_it(values: list[float]) -> None:
    one, two = values[:6], values[6:]
    theirs = [
        pt.transform_from(pr.matrix_from_compact_axis_angle(v[3:]), v[:3]) for v in (one, two)
    ]
    bench = Bench()
    names = ", ".join(f"p{v}" for v in (one, two))
    bench.run(
        f"q = pose_trans({names})",
        *(f"write_output_float_register({i}, q[{i}])" for i in range(6)),
    )
    found = pose_vector.pose_from_vector(bench.controller.output_double[:6])
    np.testing.assert_allclose(found, theirs[0] @ theirs[1], atol=1e-9)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("force_mode(p[0,0,0,0,0,0], [0], [0], 2, [0])", "this controller has no force_mode"),
        ("movej([0, 0])", "the target is six numbers"),
        ("movel(p[9, 0, 0, 0, 0, 0])", "can't be reached"),
        ("movej(get_actual_joint_positions(), a=0)", "a is a finite number above 0"),
        ("x = 1 / 0", "ZeroDivisionError"),
        ("x = y", "there is no variable y"),
        ("x = [1][3]", "there is no item 3"),
        ("while True: x = 1 end", "runs without a wait"),
        ("def f(): f() end f()", "calls itself for ever"),
        ("movej()", "movej:"),
        ("write_output_integer_register(99, 1)", "there is no number 99"),
        ("set_tcp(p[0, 0, 1e200 * 1e200, 0, 0, 0])", "finite"),
    ],
)
def test_a_program_that_can_t_go_on_says_where_and_why(line: str, reason: str) -> None:
    bench = Bench()
    bench.run("sync()", line)
    assert "line 3" in bench.failure or "line 2" in bench.failure
    assert reason in bench.failure
    assert not bench.controller.moving


@pytest.mark.parametrize(
    "script",
    [
        "def f():\n x = \nend\n",
        "def f():\n if True:\nend\n",
        "def 3():\nend\n",
        "x = ]",
        "x = $",
        "(",
    ],
)
def test_what_is_no_urscript_is_refused(script: str) -> None:
    with pytest.raises(ScriptError):
        compile_program(script)


WORDS = [
    *("def", "end", "while", "if", "elif", "else", "True", ":", "(", ")", "[", "]", "p[", ","),
    *("=", "==", "+", "-", "f", "x", "1", "2.5", "\n", "run", "kill", "global", "return"),
    *("break", "not", "and", '"s"', "movej", "sync", "thread", "halt", "1e999", "join"),
]


@settings(max_examples=300, deadline=None)
@given(st.lists(st.sampled_from(WORDS), max_size=60))
def test_no_text_does_more_than_end_its_program(words: list[str]) -> None:
    bench = Bench()
    for script in IncomingScripts().add(" ".join(words) + "\nend\n"):
        try:
            bench.controller.start_script(script)
        except ScriptError:
            continue
        for _ in range(5):
            bench.controller.advance_one_tick()


def test_a_blended_path_keeps_its_speed_and_rounds_its_corners() -> None:
    T = KINEMATICS.forward(HOME)
    steps = np.array([[0.0, 0.0, 0.0], [0.08, 0.0, 0.0], [0.12, 0.05, 0.0], [0.2, 0.05, 0.02]])
    corners = T[:3, 3] + steps
    poses = []
    for corner in corners[1:]:
        pose = T.copy()
        pose[:3, 3] = corner
        poses.append(written(pose))
    speed, radius = 0.05, 0.01
    bench = Bench()
    bench.run(
        "set_standard_digital_out(3, True)",
        *(f"movep({pose}, a=1.0, v={speed}, r={radius})" for pose in poses[:-1]),
        f"movep({poses[-1]}, a=1.0, v={speed})",
        "set_standard_digital_out(3, False)",
    )
    assert not bench.failure
    points = np.array([pose[:3, 3] for pose in bench.poses])
    np.testing.assert_allclose(points[-1], corners[-1], atol=1e-6)
    # On the polyline, but about the corners: there a parabola of this radius comes no nearer.
    distance = np.min([_distances(points, *ends) for ends in pairwise(corners)], axis=0)
    near = np.linalg.norm(points[:, None] - corners[1:-1], axis=-1).min(axis=1) < radius + 1e-4
    assert distance[~near].max() < 5e-5
    assert 1e-4 < distance[near].max() < radius / 2
    pace = np.linalg.norm(np.diff(points, axis=0), axis=1) * HZ
    ends = np.linalg.norm(points[:, None] - corners[[0, -1]], axis=-1).min(axis=1)[1:] > 0.01
    assert np.abs(pace[ends] / speed - 1).max() < 0.02
    on = np.array(bench.outputs) == 8
    first, last = np.flatnonzero(on)[[0, -1]]
    np.testing.assert_allclose(points[first], corners[0], atol=1e-3)
    np.testing.assert_allclose(points[last], corners[-1], atol=1e-3)


def _distances(points: Array, start: Array, end: Array) -> Array:
    way = end - start
    share = np.clip((points - start) @ way / (way @ way), 0, 1)
    return np.asarray(np.linalg.norm(points - start - share[:, None] * way, axis=1))


def test_an_arc_passes_through_its_points_on_a_circle() -> None:
    T = KINEMATICS.forward(HOME)
    via, end = T.copy(), T.copy()
    via[:3, 3] += (0.03, 0.03, 0.0)
    end[:3, 3] += (0.06, 0.0, 0.0)
    bench = Bench()
    bench.run(f"movec({written(via)}, {written(end)}, a=0.5, v=0.1)")
    points = np.array([pose[:3, 3] for pose in bench.poses])
    centre = T[:3, 3] + (0.03, 0.0, 0.0)
    radii = np.linalg.norm(points - centre, axis=1)
    assert np.abs(radii - 0.03).max() < 2e-5
    assert np.linalg.norm(points - via[:3, 3], axis=1).min() < 1e-3
    np.testing.assert_allclose(points[-1], end[:3, 3], atol=1e-6)


def test_the_tool_moves_on_the_line_that_its_own_tcp_draws() -> None:
    bench = Bench()
    tcp = (0.02, -0.1, 0.3, 0.1, 0.4, -0.2)
    T = KINEMATICS.forward(HOME) @ pose_vector.pose_from_vector(tcp)
    end = T @ pose_vector.pose_from_vector([0.05, 0.02, 0.0, 0.0, 0.0, 0.3])
    bench.run(f"set_tcp(p{list(tcp)})", f"movel({written(end)}, a=0.5, v=0.1)")
    points = np.array([(pose @ pose_vector.pose_from_vector(tcp))[:3, 3] for pose in bench.poses])
    assert _distances(points, T[:3, 3], end[:3, 3]).max() < 2e-5
    np.testing.assert_allclose(points[-1], end[:3, 3], atol=1e-6)


def test_a_speed_is_ramped_up_kept_and_let_go() -> None:
    bench = Bench()
    bench.run("speedj([0, 0, 0, 0, 0, 0.4], 0.8, 1.0)", "sleep(0.5)")
    assert not bench.failure
    turned = bench.controller.q[5] - HOME[5]
    assert turned == pytest.approx(0.4 * 0.5 / 2 + 0.4 * 0.5 + 0.4**2 / 2 / 10, abs=0.01)
    assert np.abs(bench.controller.speed).max() == 0


def test_the_tool_keeps_a_velocity() -> None:
    bench = Bench()
    before = KINEMATICS.forward(HOME)[:3, 3]
    bench.run("speedl([0, 0, 0.05, 0, 0, 0], 0.5, 1.0)", "stopl(1.0)")
    moved = bench.poses[-1][:3, 3] - before
    assert moved[2] == pytest.approx(0.05 * 1.0 - 0.05**2 / 0.5 / 2, abs=0.005)
    assert np.abs(moved[:2]).max() < 1e-3


def test_servo_follows_what_it_is_told_again_and_again() -> None:
    bench = Bench()
    bench.run(
        "global q = get_actual_joint_positions()",
        "k = 0",
        "while k < 250:",
        "  q[5] = q[5] + 0.002",
        "  servoj(q, t=0.008, lookahead_time=0.1, gain=300)",
        "  k = k + 1",
        "end",
        "k = 0",
        "while k < 100:",
        "  servoj(q, t=0.008, lookahead_time=0.05, gain=300)",
        "  k = k + 1",
        "end",
    )
    assert not bench.failure
    assert bench.controller.q[5] - HOME[5] == pytest.approx(0.5, abs=1e-4)


def test_past_a_joints_limit_the_arm_stops_protectively() -> None:
    bench = Bench()
    bench.controller.start_script("speedj([0, 0, 0, 0, 0, 3.0], 10, 10)\n")
    for _ in range(1000):
        bench.controller.advance_one_tick()
    assert bench.controller.safety.name == "PROTECTIVE_STOP"
    assert bench.controller.q[5] <= KINEMATICS.upper[5]


def test_a_program_beside_another_ends_with_it() -> None:
    controller = Bench().controller
    beside = "\n".join(
        (
            "sec count():",
            "while True:",
            "write_output_integer_register(5, read_output_integer_register(5) + 1)",
            "sync()",
            "end",
            "end\n",
        )
    )

    def counted() -> int:
        before = controller.output_int[5]
        for _ in range(10):
            controller.advance_one_tick()
        return controller.output_int[5] - before

    controller.start_script("def wait():\n  sleep(9)\nend\n")
    controller.start_script(beside)
    assert counted() == 10
    controller.stop_program()
    assert counted() == 0
    controller.start_script("def wait():\n  sleep(9)\nend\n")
    assert counted() == 0


def test_programs_come_whole_however_their_text_is_cut() -> None:
    text = "def f():\n  sync()\nend\nset_digital_out(1, True)\nsec g():\nend\n"
    for size in (1, 3, 7, len(text)):
        incoming = IncomingScripts()
        found = [
            script
            for start in range(0, len(text), size)
            for script in incoming.add(text[start : start + size])
        ]
        assert [script.split("(")[0] for script in found] == ["def f", "set_digital_out", "sec g"]
