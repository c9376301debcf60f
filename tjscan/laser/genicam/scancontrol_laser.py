"""A scanCONTROL 26xx, 27xx or 29xx as a `LineLaser`."""

from __future__ import annotations

from tjscan.laser.genicam.gige import GigeLaser
from tjscan.laser.genicam.messages import ConnectedLaser, ReceivedBlock, StreamSetup
from tjscan.laser.genicam.settings import ScanControlSettings
from tjscan.laser.line_laser import LaserDescription
from tjscan.laser.profile import Profile
from tjscan.laser.scancontrol import (
    GREATEST_RAW,
    MODEL_SCALES,
    RAW_ZERO,
    ScanControlScale,
    parse_scancontrol,
    row_bytes,
)


class ScanControlLaser(GigeLaser[ScanControlSettings]):
    """A `LineLaser` with the transport of GigE Vision and a payload of its own.

    It runs free, and what its stream stamps earlier than the call, and the margin after it, is
    thrown away. No such sensor was at hand: the payload is read as its documents have it.

    Parameters
    ----------
    settings : ScanControlSettings
        How to reach it, and how it is set up.
    time : callable
        Gives the seconds on the clock of the cell.
    """

    @property
    def scale(self) -> ScanControlScale:
        """Scale and offset of its model, or those that the job states."""
        table = self.settings
        if table.scale is not None and table.offset is not None:
            return ScanControlScale(table.scale, table.offset)
        return MODEL_SCALES[str(table.model)]

    def describe(self) -> LaserDescription:
        """Describe the laser and its link; raises as `connected` does."""
        table, scale = self.settings, self.scale
        raw = (GREATEST_RAW - 1, 0) if table.flip_z else (1, GREATEST_RAW)  # 0 as sent is no point
        near, far = (scale.scale * (end - RAW_ZERO) + scale.offset for end in sorted(raw))
        return LaserDescription(
            link=self._link(row_bytes(table)),
            format=f"{table.layout} profiles, {table.points} points, {1e3 * scale.scale:g} mm a "
            f"count about x 0 and z {1e3 * scale.offset:g} mm, as the job states",
            near=near,
            far=far,
            advice=self._advice(),
        )

    def _setup(self) -> StreamSetup:
        registers = {int(at, 16): value for at, value in self.settings.registers.items()}
        return StreamSetup(trigger="fresh", registers=registers, margin=self.settings.margin)

    def _understand(self, laser: ConnectedLaser) -> None:
        """Nothing is asked: the job states how it is set up."""

    def _profile(self, block: ReceivedBlock, time: float, uncertainty: float) -> Profile:
        return parse_scancontrol(block.data, self.settings, self.scale, time, uncertainty)
