"""``tjscan vehicle-loopback``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tjscan.vehicle.loopback.towing import TowingBodies


def vehicle_loopback(
    *,
    vehicles: int | None = None,
    broker: str = "127.0.0.1:1883",
    prefix: str = "tjscan/vehicle",
    settings: Path | None = None,
    seed: int = 0,
    attached: bool = False,
) -> None:
    """Stand in for vehicles on this machine, behind an MQTT broker on it, until interrupted.

    With the job of a tow they hold its cable and are seen by a tracker; else they are crawlers. A
    line on stdin commands a fault: drive-fault, drop-link, freeze, stale or nan; of crawlers slip,
    edge or arc; at a cable stop, push, passer-stands, or what goes wrong with poses, such as
    pose-lost. clear sets all right again. With a number behind it, it is for that vehicle alone.

    Parameters
    ----------
    vehicles
        How many; their topics begin with the prefix and their number, 1, 2, ... One crawler, or as
        many as the tow has, where left out.
    broker
        HOST:PORT of a broker on this machine, such as mosquitto.
    prefix
        Of all topics.
    settings
        A job file whose [simulation.vehicle] and [vehicle.tracks] the crawlers have, or that of a
        tow.
    seed
        Of their random numbers.
    attached
        End when stdin ends.
    """
    from tjscan.vehicle.drivers import VEHICLES

    with VEHICLES.explain_missing_package("mqtt"):
        from tjscan.vehicle.loopback.serve import run_loopback_vehicles

    towing = None if settings is None else _read_tow(settings, seed)
    if vehicles is None:
        vehicles = 1 if towing is None else len(towing.bodies)
    run_loopback_vehicles(
        vehicles, broker, prefix, settings=settings, seed=seed, attached=attached, towing=towing
    )


def _read_tow(file: Path, seed: int) -> TowingBodies | None:
    """The vehicles of a tow; None where the file is another job."""
    from tjscan.core.config import read_toml

    if "seam" not in read_toml(file):
        return None
    from tjscan.job.tow.sweep import read_towing_world
    from tjscan.vehicle.cable.world import TowingWorld
    from tjscan.vehicle.loopback.towing import TowingBodies

    model, angles, localisation = read_towing_world(file)
    return TowingBodies(TowingWorld(model, angles, seed=seed), localisation, seed)
