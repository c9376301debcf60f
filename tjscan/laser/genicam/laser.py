"""A laser with GenICam's Scan3d features as a `LineLaser`, and what its numbers mean."""

from __future__ import annotations

from math import inf
from typing import Final

from tjscan.core.errors import ProfileFormatRefused
from tjscan.laser.genicam.gige import GigeLaser
from tjscan.laser.genicam.messages import ConnectedLaser, ReceivedBlock, StatedAxis, StreamSetup
from tjscan.laser.genicam.settings import GenicamSettings
from tjscan.laser.line_laser import LaserDescription
from tjscan.laser.profile import Profile
from tjscan.laser.scan3d import COORDINATE_FORMATS, AxisScale, Scan3dScales, points

MILLIMETER_UNIT: Final = "Millimeter"
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
        If neither states what the numbers mean, or the laser states that they are no millimetres.
    """
    layout = COORDINATE_FORMATS.get(laser.pixel_format)
    if layout is None:
        raise ProfileFormatRefused(
            f"the laser is set to {laser.pixel_format}; what can be read is "
            f"{', '.join(COORDINATE_FORMATS)}"
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
    if laser.unit != MILLIMETER_UNIT:
        what = "does not state it" if laser.unit is None else f"states {laser.unit}"
        raise ProfileFormatRefused(
            f"the laser {what}: its Scan3dDistanceUnit should be {MILLIMETER_UNIT}. {STATE_THEM}"
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


class GenicamLaser(GigeLaser[GenicamSettings]):
    """A `LineLaser` that speaks GigE Vision with GenICam's Scan3d features.

    Parameters
    ----------
    settings : GenicamSettings
        How to reach it, and what its numbers mean if it does not state that.
    time : callable
        Gives the seconds on the clock of the cell.
    """

    @property
    def scales(self) -> Scan3dScales:
        """How its numbers become metres; raises as `connected` does."""
        return scales_of_laser(self.connected, self.settings)

    def describe(self) -> LaserDescription:
        """Describe the laser and its link; raises as `connected` does."""
        laser, scales, table = self.connected, self.scales, self.settings
        layout = COORDINATE_FORMATS[laser.pixel_format]
        axes = ", ".join(
            f"{name} = {1e3 * axis.scale:.6g} mm * raw {1e3 * axis.offset:+.6g} mm"
            for name, axis in (("x", scales.x), ("z", scales.z))
        )
        stated = "as the laser states" if table.scale is None else "as the job states"
        ends = [scales.z.scale * raw + scales.z.offset for raw in layout.raw_range(scales.z)]
        return LaserDescription(
            link=self._link(layout.point_size * laser.columns * laser.rows),
            format=f"{laser.pixel_format}, {laser.columns} points, rows: {laser.rows}, {axes}, "
            f"{stated}",
            near=min(ends),
            far=max(ends),
            advice=self._advice(),
        )

    def _setup(self) -> StreamSetup:
        table = self.settings
        return StreamSetup(
            trigger=table.trigger,
            pixel_format=table.pixel_format,
            chooses_format=True,
            exposure=table.exposure,
            rows=table.rows,
        )

    def _understand(self, laser: ConnectedLaser) -> None:
        scales_of_laser(laser, self.settings)  # refuses what it can't read

    def _profile(self, block: ReceivedBlock, time: float, uncertainty: float) -> Profile:
        row = COORDINATE_FORMATS[block.pixel_format].point_size * block.columns
        if len(block.data) < row:
            raise ProfileFormatRefused(
                f"a block of {len(block.data)} bytes holds no {block.columns} points in "
                f"{block.pixel_format}"
            )
        return points(block.data[:row], block.pixel_format, self.scales, time, uncertainty)
