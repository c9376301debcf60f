"""Path of the torch across the groove during a pass: offset, weave, dwell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le, MinLen

from tjscan.core.units import MM, MM_S, SECONDS, SettingsTable


@dataclass(frozen=True, slots=True, kw_only=True)
class PassSettings(SettingsTable):
    """One welding pass, a table [[pass]].

    Parameters
    ----------
    speed : float
        Along the joint, m/s.
    offset : float
        Of the torch's path from the joint's centre, positive to the right, metres.
    height : float
        Of the torch over the hull, out of it, metres; below zero inside the groove.
    weave : float
        How far it swings to either side of that, metres; 0 for a stringer bead.
    weave_period : float
        Of a whole swing there and back, dwells included, seconds.
    dwell : float
        How long it stays at each end, seconds.
    procedure : str, optional
        Which welding procedure specification holds; the job's if left out.
    """

    speed: Annotated[float, Gt(0), Le(100), MM_S] = 5e-3
    offset: Annotated[float, Ge(-50), Le(50), MM] = 0.0
    height: Annotated[float, Ge(-100), Le(100), MM] = 0.0
    weave: Annotated[float, Ge(0), Le(50), MM] = 0.0
    weave_period: Annotated[float, Gt(0), Le(60), SECONDS] = 2.0
    dwell: Annotated[float, Ge(0), Le(10), SECONDS] = 0.0
    procedure: Annotated[str | None, MinLen(1)] = None

    def __post_init__(self) -> None:
        if self.weave > 0 and not 2 * self.dwell < self.weave_period:
            raise ValueError("two dwell_s leave no time to swing: make weave_period_s longer")

    def offset_at(self, time: float) -> float:
        """Offset of the torch from the joint's centre, metres.

        Parameters
        ----------
        time : float
            Since the arc was struck, seconds.
        """
        if self.weave == 0.0:
            return self.offset
        swing = self.weave_period / 2 - self.dwell
        into = (time + swing / 2) % self.weave_period  # it begins in the middle, to the right
        back = into >= self.weave_period / 2
        into -= self.weave_period / 2 if back else 0.0
        share = min(into / swing, 1.0) * 2 - 1
        return self.offset + self.weave * (-share if back else share)
