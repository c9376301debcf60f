"""Arms of three makers before the paper's joint: where it is moved to, and where they start."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from tjscan.core import errors

JOB: Final = Path(__file__).resolve().parents[1] / "examples" / "kr5_arc.toml"

JOINT_SOLIDS: Final = ("leg", "brace")
"""What the arm keeps clear of, and is moved with the joint; each arm has a foot of its own."""


@dataclass(frozen=True)
class MakersArm:
    """A maker's arm: its driver, its model, where the joint is for it, and its controller."""

    name: str
    model: str
    home_deg: tuple[float, ...]
    shift_mm: tuple[float, float, float]
    host: str
    stamp: str
    cycle_ms: int
    time_out: float
    stands_in: type[errors.ArmFault] = errors.ProtectiveStop

    @property
    def options(self) -> tuple[str, ...]:
        """Options of its loopback: it starts where the scan does, and has long cycles."""
        home = map(str, self.home_deg)
        return ("--fast", "--cycle-ms", str(self.cycle_ms), "--home-deg", *home)

    def job_keys(self) -> dict[str, Any]:
        """Keys of the example that put this arm before the joint."""
        text = tomllib.loads(JOB.read_text(encoding="utf-8"))

        def moved(position: list[float]) -> list[float]:
            return [a + b for a, b in zip(position, self.shift_mm, strict=True)]

        solids = [
            solid | {"position_mm": moved(solid["position_mm"])}
            for solid in text["clearance"]["solid"]
            if solid["name"] in JOINT_SOLIDS
        ]
        return {
            "arm.model": self.model,
            "simulation.arm.home_deg": list(self.home_deg),
            "scan.first.position_mm": moved(text["scan"]["first"]["position_mm"]),
            "scan.second.position_mm": moved(text["scan"]["second"]["position_mm"]),
            "joint.position_mm": moved(text["joint"]["position_mm"]),
            "clearance.solid": solids,
            "scan.step_mm": 80.0,
            "scan.length_mm": 400.0,
        }


ABB: Final = MakersArm(
    *(
        "abb",
        "irb1600_10_145",
        (91, 46, -6, -62, 85, -57),
        (0, -150, -100),
        "127.0.0.6",
        "seqno",
        24,
        1.0,
    )
)
KUKA: Final = MakersArm(
    *("kuka", "kr5_arc", (-90, -60, 65, 60, 95, 75), (0, 0, 0), "127.0.0.5", "ipoc", 12, 1.2)
)
FANUC: Final = MakersArm(
    *(
        "fanuc",
        "m10ia",
        (93, 22, -9, -119, 90, 65),
        (0, -250, -300),
        "127.0.0.7",
        "number",
        24,
        0.24,
    ),
    stands_in=errors.EmergencyStop,
)
