"""A laser with GenICam's Scan3d features as a `LineLaser`."""

from __future__ import annotations

from collections.abc import Callable

from tjscan.core.errors import LaserFault, ProfileFormatRefused
from tjscan.laser.genicam.driver import GenicamSettings
from tjscan.laser.genicam.gige import GigeLaser
from tjscan.laser.genicam.messages import ConnectedLaser, ReceivedBlock, StreamSetup
from tjscan.laser.genicam.scales import scales_of_laser
from tjscan.laser.line_laser import LaserDescription
from tjscan.laser.profile import Profile
from tjscan.laser.scan3d import FORMATS, Scan3dScales, points


class GenicamLaser(GigeLaser):
    """A `LineLaser` that speaks GigE Vision with GenICam's Scan3d features.

    Parameters
    ----------
    settings : GenicamSettings
        How to reach it, and what its numbers mean where it does not say.
    time : callable
        Gives the seconds on the clock of the cell.
    """

    def __init__(self, settings: GenicamSettings, time: Callable[[], float]) -> None:
        super().__init__(settings, time)
        self.settings = settings
        self._scales: Scan3dScales | None = None

    @property
    def scales(self) -> Scan3dScales:
        """How its numbers become metres; raises as `connected` does."""
        self.connected  # noqa: B018 - refuses
        if self._scales is None:
            raise LaserFault("the laser has not been connected yet")
        return self._scales

    def describe(self) -> LaserDescription:
        """Describe the laser and its link; raises as `connected` does."""
        laser, scales, table = self.connected, self.scales, self.settings
        layout = FORMATS[laser.pixel_format]
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
        self._scales = scales_of_laser(laser, self.settings)

    def _profile(self, block: ReceivedBlock, time: float, uncertainty: float) -> Profile:
        row = FORMATS[block.pixel_format].point_size * block.columns
        if len(block.data) < row:
            raise ProfileFormatRefused(
                f"a block of {len(block.data)} bytes holds no {block.columns} points in "
                f"{block.pixel_format}"
            )
        return points(block.data[:row], block.pixel_format, self.scales, time, uncertainty)
