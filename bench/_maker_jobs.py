"""Arms of three makers before the paper's joint, and their loopback controllers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from tjscan.core import errors

EXAMPLES: Final = Path(__file__).resolve().parents[1] / "examples"

SHORT: Final[dict[str, Any]] = {"scan.step_mm": 80.0, "scan.length_mm": 400.0}
"""Keys of a short scan."""


@dataclass(frozen=True, kw_only=True)
class MakersArm:
    """A maker's arm: its driver, the example that scans with it, and its controller."""

    name: str
    model: str
    host: str
    stamp: str
    cycle_ms: int
    time_out: float
    stands_in: type[errors.ArmFault] = errors.ProtectiveStop

    @property
    def job(self) -> Path:
        """The example; the loopback controller starts where its arm does."""
        return EXAMPLES / f"{self.model}.toml"

    @property
    def options(self) -> tuple[str, ...]:
        """Options of its loopback: it has long cycles."""
        return ("--fast", "--cycle-ms", str(self.cycle_ms))


ABB: Final = MakersArm(
    name="abb",
    model="irb1600_10_145",
    host="127.0.0.6",
    stamp="seqno",
    cycle_ms=24,
    time_out=1.0,
)
KUKA: Final = MakersArm(
    name="kuka",
    model="kr5_arc",
    host="127.0.0.5",
    stamp="ipoc",
    cycle_ms=12,
    time_out=1.2,
)
FANUC: Final = MakersArm(
    name="fanuc",
    model="m10ia",
    host="127.0.0.7",
    stamp="number",
    cycle_ms=24,
    time_out=0.24,
    stands_in=errors.EmergencyStop,
)
