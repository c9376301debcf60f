"""``tjscan vehicle-loopback``."""

from __future__ import annotations

from pathlib import Path


def vehicle_loopback(
    *,
    vehicles: int = 1,
    broker: str = "127.0.0.1:1883",
    prefix: str = "tjscan/vehicle",
    settings: Path | None = None,
    seed: int = 0,
    attached: bool = False,
) -> None:
    """Stand in for vehicles on this machine, behind an MQTT broker on it, until interrupted.

    A line on stdin commands a fault: drive-fault, drop-link, freeze, stale, nan, slip, edge or
    arc; clear sets all right again. With a number behind it, it is for that vehicle alone.

    Parameters
    ----------
    vehicles
        How many; their topics begin with the prefix and their number, 1, 2, ...
    broker
        HOST:PORT of a broker on this machine, such as mosquitto.
    prefix
        Of all topics.
    settings
        A job file whose [simulation.vehicle] and [vehicle.tracks] the vehicles have.
    seed
        Of their random numbers.
    attached
        End when stdin ends.
    """
    from tjscan.vehicle.drivers import VEHICLES

    with VEHICLES.explain_missing_package("mqtt"):
        from tjscan.vehicle.loopback.serve import run_loopback_vehicles

    run_loopback_vehicles(vehicles, broker, prefix, settings=settings, seed=seed, attached=attached)
