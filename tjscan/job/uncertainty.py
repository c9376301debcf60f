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

LINEARITY: Final = 0.1e-3
"""Metres: assumption, 0.1 % of a 100 mm range; data sheets of the class state 0.1 to 0.2 %."""

RANGE_BIAS: Final = 0.02e-3
"""Metres: assumption, what the simulated laser has by default (`tjscan.laser.model`)."""

STATED: Final = "stated"
ASSUMED: Final = "assumed"


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmUncertaintySettings(SettingsTable):
    """The table [arm.uncertainty]: how far the arm may stand from where it reports.

    Parameters
    ----------
    absolute : float, optional
        Root mean square of the flange's distance from where it is reported, because the links
        are not as the model has them; metres. Where left out, joints deviate as
        `tjscan.robot.tolerance.PlacementTolerance` assumes, some 0.4 mm at the flange of an arm
        of a metre and more. An arm that was calibrated with its sensor has what its calibration
        found instead.
    repeatability, angular_repeatability : float, optional
        Root mean square of the distance (metres) and the angle (radians) by which the arm does
        not repeat; those of `tjscan.joint.tubes.fit.ArmRepeatability` where left out.
    """

    absolute: Annotated[float | None, Ge(0), Le(20), MM] = None
    repeatability: Annotated[float | None, Ge(0), Le(5), MM] = None
    angular_repeatability: Annotated[
        float | None, Ge(0), Le(5), DEG.with_key("repeatability_deg")
    ] = None

    @property
    def repeats(self) -> tuple[ArmRepeatability, str]:
        """What repeatability is taken for, and whether any of it is stated."""
        default = ArmRepeatability()
        position, evidence = _stated_or(self.repeatability, default.position)
        angle, of_angle = _stated_or(self.angular_repeatability, default.angle)
        return ArmRepeatability(position, angle), STATED if STATED in (
            evidence,
            of_angle,
        ) else ASSUMED


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserUncertaintySettings(SettingsTable):
    """The table [laser.uncertainty]: how far the laser's profiles may be from the truth.

    Parameters
    ----------
    linearity : float, optional
        Largest deviation of the range over the window, as data sheets state it, metres;
        `LINEARITY` where left out.
    range_bias : float, optional
        Standard deviation of the range's error at 45° of incidence, which grows with the
        tangent of the incidence, metres; `RANGE_BIAS` where left out.
    """

    linearity: Annotated[float | None, Ge(0), Le(5), MM] = None
    range_bias: Annotated[float | None, Ge(0), Le(5), MM] = None

    @property
    def linear(self) -> tuple[float, str]:
        """What `linearity` is taken for, metres, and whether it is stated or assumed."""
        return _stated_or(self.linearity, LINEARITY)

    @property
    def bias(self) -> tuple[float, str]:
        """What `range_bias` is taken for, metres, and whether it is stated or assumed."""
        return _stated_or(self.range_bias, RANGE_BIAS)


def _stated_or(value: float | None, default: float) -> tuple[float, str]:
    return (default, ASSUMED) if value is None else (value, STATED)
