"""How to reach a vehicle over a broker."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le, Len, MinLen

from tjscan.core.units import SECONDS, SettingsTable
from tjscan.vehicle.vehicle import DEAD_MAN_TIME


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokerSettings(SettingsTable):
    """A broker, and what all topics of a device begin with there.

    Parameters
    ----------
    host : str
        The broker's address; nothing else is connected to.
    port : int
        Its port.
    prefix : str
        Of the topics.
    user : str
        Whom the broker lets in; empty where it lets in anyone.
    password_file : str
        Absolute path of a file with the user's password: a job is copied into each run.
    ca_file : str
        Absolute path of the certificate that signs the broker's; with it the link is encrypted.
    """

    host: Annotated[str, MinLen(1)] = "127.0.0.1"
    port: Annotated[int, Ge(1), Le(65535)] = 1883
    prefix: str = "tjscan"
    user: str = ""
    password_file: str = ""
    ca_file: str = ""

    def __post_init__(self) -> None:
        if self.password_file and not self.user:
            raise ValueError("password_file needs user, whose password it is")
        for name in ("password_file", "ca_file"):
            if (path := getattr(self, name)) and not Path(path).is_absolute():
                raise ValueError(f"{name} is a file's absolute path, not {path}")
        if set(self.prefix) & set("+#\0") or self.prefix.startswith(("$", "/")):
            raise ValueError("prefix is a topic: without + and #, and not behind $ or /")


@dataclass(frozen=True, slots=True, kw_only=True)
class MqttSettings(BrokerSettings):
    """The table [vehicle.mqtt]: the broker, the vehicle's topics, and time limits.

    Parameters
    ----------
    host : str
        The broker's address; nothing else is connected to.
    port : int
        Its port.
    prefix : str
        Of the vehicle's topics, such as ``tjscan/vehicle/1``.
    dead_man : float
        Seconds after the last command at which the vehicle must stop. It has the same limit
        of its own, so a longer one would mean nothing.
    connect_limit : float
        Seconds that a connection may take.
    silence_limit : float
        Seconds without a new state after which the link counts as lost.
    """

    prefix: Annotated[str, Len(1, 200)] = "tjscan/vehicle/1"
    dead_man: Annotated[float, Ge(0.05), Le(DEAD_MAN_TIME), SECONDS] = DEAD_MAN_TIME
    connect_limit: Annotated[float, Ge(0.1), Le(120), SECONDS.with_key("connect_s")] = 5.0
    silence_limit: Annotated[float, Ge(0.05), Le(60), SECONDS.with_key("silence_s")] = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamMqttSettings(MqttSettings):
    """The table [vehicles.mqtt]: the broker, and what the topics of all vehicles begin with.

    Parameters
    ----------
    prefix : str
        Of all topics; a vehicle's topics go on with its number, 1, 2, ...
    """

    prefix: Annotated[str, Len(1, 190)] = "tjscan/vehicle"


@dataclass(frozen=True, slots=True, kw_only=True)
class MqttLocalisationSettings(BrokerSettings):
    """The table [localisation.mqtt]: the broker, and the topics with poses there.

    Parameters
    ----------
    host : str
        The broker's address; nothing else is connected to.
    port : int
        Its port.
    prefix : str
        Of the team's topics: poses come on ``PREFIX/1/pose`` and so on.
    connect_limit : float
        Seconds in which every vehicle must be seen first.
    """

    prefix: Annotated[str, Len(1, 190)] = "tjscan/vehicle"
    connect_limit: Annotated[float, Ge(0.1), Le(120), SECONDS.with_key("connect_s")] = 5.0
