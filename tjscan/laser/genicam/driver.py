"""A GenICam laser as a driver that a job can name."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Final

from tjscan.laser.drivers import LASER_DRIVERS, LaserDriverFactory, LaserDriverInputs
from tjscan.laser.genicam.settings import GenicamSettings

if TYPE_CHECKING:
    from tjscan.laser.genicam.laser import GenicamLaser

CLIENT: Final = "viva_genicam"
"""Module of the package viva-genicam."""


def _make(inputs: LaserDriverInputs, settings: GenicamSettings) -> GenicamLaser:
    from tjscan.laser.genicam.laser import GenicamLaser

    # The client library is loaded in a process of its own alone, so look whether it is there.
    if find_spec(CLIENT) is None:
        raise LASER_DRIVERS.missing_package_error("genicam", CLIENT)
    return GenicamLaser(settings, inputs.carrier.time)


DRIVER: Final = LaserDriverFactory(_make, GenicamSettings)
