"""A straight V groove as a weld's state, and its planner, for tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tjscan.core.frames import Array
from tjscan.planning.wps import WeldingProcedure, read_wps
from tjscan.welding.replan import BeadOrder, NextBead, WeldPlanner
from tjscan.welding.state import WeldState
from tjscan.welding.world import TorchTrace, WeldFaults, WeldWorld

EXAMPLE_WPS = Path(__file__).parents[2] / "examples" / "wps.toml"


def v_groove(stations: int = 41, step: float = 2e-3, tilt: float = 0.1) -> WeldState:
    """A groove of 60°, 12 mm deep over a gap of 3 mm; its area grows by a fifth along it."""
    s = np.linspace(0.0, step * (stations - 1), stations)
    u = np.arange(-22e-3, 22e-3, 0.4e-3)
    depth = 12e-3 * (1 + 0.1 * s / s[-1])
    slope = float(np.tan(np.pi / 3))
    half = 1.5e-3 + depth / slope
    rise = np.maximum(np.abs(u) - 1.5e-3, 0) * slope
    w = np.asarray(np.minimum(rise, depth[:, None]), dtype=np.float64)
    toes: Array = np.array((-half, half), dtype=np.float64).T
    return WeldState.of_groove(s, u, w, toes, np.full(stations, tilt))


def example_wps() -> WeldingProcedure:
    return read_wps(EXAMPLE_WPS)


def v_groove_planner(state: WeldState) -> WeldPlanner:
    order = BeadOrder(counts=(1, 2, 3), feeds=(9 / 60,) * 6, weaves=(3e-3,) * 6, cap_height=1.5e-3)
    return WeldPlanner(state, order, example_wps())


def weld_world(state: WeldState, faults: WeldFaults, seed: int = 1) -> WeldWorld:
    wire = example_wps().wire
    rng = np.random.default_rng(seed)
    return WeldWorld(state, wire.diameter, wire.deposition_efficiency, rng, faults=faults)


def torch_trace(bead: NextBead) -> TorchTrace:
    """A torch that does what a bead asks for."""
    u = bead.tip[:, 0]
    return TorchTrace(bead.s, u, bead.speed, bead.feed, bead.heat_input, bead.weave)
