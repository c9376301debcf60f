"""Lasers behind GigE Vision as drivers that a job can name."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Final

from tjscan.laser.drivers import LASER_DRIVERS, LaserDriverFactory, LaserDriverInputs
from tjscan.laser.genicam.settings import GenicamSettings, ScanControlSettings

if TYPE_CHECKING:
    from tjscan.laser.genicam.laser import GenicamLaser
    from tjscan.laser.genicam.scancontrol_laser import ScanControlLaser

CLIENT: Final = "viva_genicam"
"""Module of the package viva-genicam."""


def _genicam(inputs: LaserDriverInputs, settings: GenicamSettings) -> GenicamLaser:
    from tjscan.laser.genicam.laser import GenicamLaser

    _check_client_is_there("genicam")
    return GenicamLaser(settings, inputs.carrier.time)


def _scancontrol(inputs: LaserDriverInputs, settings: ScanControlSettings) -> ScanControlLaser:
    from tjscan.laser.genicam.scancontrol_laser import ScanControlLaser

    _check_client_is_there("scancontrol")
    return ScanControlLaser(settings, inputs.carrier.time)


def _check_client_is_there(driver: str) -> None:
    # The client library is loaded in a process of its own alone, so look whether it is there.
    if find_spec(CLIENT) is None:
        raise LASER_DRIVERS.missing_package_error(driver, CLIENT)


GENICAM: Final = LaserDriverFactory(_genicam, GenicamSettings)
SCANCONTROL: Final = LaserDriverFactory(_scancontrol, ScanControlSettings)
