"""How large the errors of arm, laser and calibration are taken to be: stated in the job or assumed.

Every default is an assumption. It holds for what the tables' documentation names, and a result
calls it assumed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from annotated_types import Ge, Le

from tjscan.core.units import DEG, MM, SettingsTable
from tjscan.joint.tubes.fit import ArmRepeatability

ASSUMED_LINEARITY: Final = 0.1e-3
"""Metres: assumption, 0.1 % of a 100 mm range; data sheets of the class state 0.1 to 0.2 %."""

ASSUMED_RANGE_BIAS: Final = 0.02e-3
"""Metres: assumption, what the simulated laser has by default (`tjscan.laser.model`)."""

EVIDENCE_STATED: Final = "stated"
EVIDENCE_ASSUMED: Final = "assumed"


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmUncertaintySettings(SettingsTable):
    """The table [arm.uncertainty]: how far the arm may be from where it reports.

    Parameters
    ----------
    absolute : float, optional
        Root mean square distance of the flange from its reported position, because the links
        deviate from the model; metres. If left out, joints deviate as
        `tjscan.robot.settings.PlacementTolerance` assumes, some 0.4 mm at the flange of an arm
        of a metre and more. An arm that was calibrated with its sensor has what its calibration
        found instead.
    repeatability, angular_repeatability : float, optional
        Root mean square of the distance (metres) and the angle (radians) by which the arm does
        not repeat; as in `tjscan.joint.tubes.fit.ArmRepeatability` if left out.
    """

    absolute: Annotated[float | None, Ge(0), Le(20), MM] = None
    repeatability: Annotated[float | None, Ge(0), Le(5), MM] = None
    angular_repeatability: Annotated[
        float | None, Ge(0), Le(5), DEG.with_key("repeatability_deg")
    ] = None

    @property
    def repeats(self) -> tuple[ArmRepeatability, str]:
        """Repeatability, and whether any of it is stated or all assumed."""
        default = ArmRepeatability()
        position, evidence = _stated_or(self.repeatability, default.position)
        angle, of_angle = _stated_or(self.angular_repeatability, default.angle)
        stated = EVIDENCE_STATED in (evidence, of_angle)
        return ArmRepeatability(position, angle), EVIDENCE_STATED if stated else EVIDENCE_ASSUMED


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserUncertaintySettings(SettingsTable):
    """The table [laser.uncertainty]: how far the laser's profiles may be from the truth.

    Parameters
    ----------
    linearity : float, optional
        Largest deviation of the range over the window, as data sheets state it, metres;
        `ASSUMED_LINEARITY` if left out.
    range_bias : float, optional
        Standard deviation of the range's error at 45° of incidence, which grows with the
        tangent of the incidence, metres; `ASSUMED_RANGE_BIAS` if left out.
    """

    linearity: Annotated[float | None, Ge(0), Le(5), MM] = None
    range_bias: Annotated[float | None, Ge(0), Le(5), MM] = None

    @property
    def linear(self) -> tuple[float, str]:
        """Linearity in metres, and whether it is stated or assumed."""
        return _stated_or(self.linearity, ASSUMED_LINEARITY)

    @property
    def bias(self) -> tuple[float, str]:
        """Range bias in metres, and whether it is stated or assumed."""
        return _stated_or(self.range_bias, ASSUMED_RANGE_BIAS)


def _stated_or(value: float | None, default: float) -> tuple[float, str]:
    return (default, EVIDENCE_ASSUMED) if value is None else (value, EVIDENCE_STATED)
