"""How a laser's numbers become metres: what it states, or what the job states instead."""

from __future__ import annotations

from math import inf
from typing import Final

from tjscan.core.errors import ProfileFormatRefused
from tjscan.laser.genicam.driver import GenicamSettings
from tjscan.laser.genicam.messages import ConnectedLaser, StatedAxis
from tjscan.laser.scan3d import FORMATS, AxisScale, Scan3dScales

MILLIMETER: Final = "Millimeter"
METRES_PER_MM: Final = 1e-3

STATE_THEM: Final = (
    "State laser.genicam.scale_mm and laser.genicam.offset_mm, for x and z, from its manual"
)


def scales_of_laser(laser: ConnectedLaser, settings: GenicamSettings) -> Scan3dScales:
    """Scale, offset, limits and invalid value of both axes.

    Parameters
    ----------
    laser : ConnectedLaser
        What it states.
    settings : GenicamSettings
        What the job states.

    Raises
    ------
    ProfileFormatRefused
        If neither says what the numbers mean, or the laser says that they are no millimetres.
    """
    layout = FORMATS.get(laser.pixel_format)
    if layout is None:
        raise ProfileFormatRefused(
            f"the laser is set to {laser.pixel_format}; what can be read is {', '.join(FORMATS)}"
        )
    if settings.scale is not None and settings.offset is not None:
        pairs = list(zip(settings.scale, settings.offset, strict=True))
    else:
        _check_states_millimetres(laser)
        pairs = [_stated(axis, laser) for axis in (laser.x, laser.z)]
    axes = [
        AxisScale(scale, offset, *(_limits(axis) if settings.axis_limits else (-inf, inf)))
        for (scale, offset), axis in zip(pairs, (laser.x, laser.z), strict=True)
    ]
    x, z = (
        axis.flipped() if flip else axis
        for axis, flip in zip(axes, (settings.flip_x, settings.flip_z), strict=True)
    )
    invalid = laser.z.invalid if settings.invalid is None else settings.invalid
    return Scan3dScales(x, z, invalid)


def _check_states_millimetres(laser: ConnectedLaser) -> None:
    if laser.output_mode is not None and laser.output_mode.startswith("Uncalibrated"):
        raise ProfileFormatRefused(
            f"the laser's Scan3dOutputMode is {laser.output_mode}: its numbers are no lengths. Set "
            "a calibrated or rectified one, with laser.genicam.features.Scan3dOutputMode"
        )
    if laser.unit != MILLIMETER:
        what = "does not say" if laser.unit is None else f"says {laser.unit}"
        raise ProfileFormatRefused(
            f"the laser {what}, where its Scan3dDistanceUnit should say {MILLIMETER}. {STATE_THEM}"
        )


def _stated(axis: StatedAxis, laser: ConnectedLaser) -> tuple[float, float]:
    """Scale and offset in metres, as the laser states them."""
    if axis.scale is None or axis.offset is None:
        raise ProfileFormatRefused(
            f"the laser does not state Scan3dCoordinateScale and Scan3dCoordinateOffset of its "
            f"{laser.pixel_format}. {STATE_THEM}"
        )
    return METRES_PER_MM * axis.scale, METRES_PER_MM * axis.offset


def _limits(axis: StatedAxis) -> tuple[float, float]:
    """Least and greatest raw number, where they bound anything."""
    if axis.low is None or axis.high is None or not axis.low < axis.high:
        return -inf, inf
    return axis.low, axis.high
