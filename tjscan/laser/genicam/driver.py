"""Line lasers that speak GenICam as drivers that a job can name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from tjscan.laser.drivers import LaserDriverFactory, LaserDriverInputs
from tjscan.laser.genicam.settings import GenicamSettings, ScanControlSettings

if TYPE_CHECKING:
    from tjscan.laser.genicam.laser import GenicamLaser
    from tjscan.laser.genicam.scancontrol_laser import ScanControlLaser


def _genicam(inputs: LaserDriverInputs, settings: GenicamSettings) -> GenicamLaser:
    from tjscan.laser.genicam.laser import GenicamLaser

    return GenicamLaser(settings, inputs.carrier.time)


def _scancontrol(inputs: LaserDriverInputs, settings: ScanControlSettings) -> ScanControlLaser:
    from tjscan.laser.genicam.scancontrol_laser import ScanControlLaser

    return ScanControlLaser(settings, inputs.carrier.time)


GENICAM_DRIVER: Final = LaserDriverFactory(_genicam, GenicamSettings)
SCANCONTROL_DRIVER: Final = LaserDriverFactory(_scancontrol, ScanControlSettings)
