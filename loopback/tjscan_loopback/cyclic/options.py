"""Options of the commands that simulate controllers which ask for joint angles in every cycle."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

SixAngles = tuple[float, float, float, float, float, float]


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class CyclicOptions:
    """Options of every such controller.

    Parameters
    ----------
    model
        The arm, or the path of its URDF.
    host
        Its address, 127.0.0.1 to 127.255.255.254.
    cycle_ms
        Milliseconds between two of its packets.
    realtime
        Whether its clock runs with the wall's; with --fast it waits for each answer, and moves
        run as fast as answers come.
    home_deg
        Where the arm starts, six joint angles of the model in degrees.
    attached
        End when stdin ends.
    """

    model: str
    host: str
    cycle_ms: int
    realtime: Annotated[bool, Parameter(negative="--fast")] = True
    home_deg: SixAngles
    attached: bool = False


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class KukaOptions(CyclicOptions):
    """Options of a KUKA controller.

    Parameters
    ----------
    computer
        HOST:PORT on this machine to which it sends.
    timeout
        Answers that may be late or missing until it stops.
    """

    model: str = "kr5_arc"
    host: str = "127.0.0.5"
    computer: str = "127.0.0.1:59152"
    cycle_ms: Literal[4, 12] = 4
    timeout: Annotated[int, Parameter(validator=Number(gte=0))] = 100
    home_deg: SixAngles = (-90, -60, 65, 60, 95, 75)


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class AbbOptions(CyclicOptions):
    """Options of an ABB controller.

    Parameters
    ----------
    computer
        HOST:PORT on this machine to which it sends.
    timeout_s
        Seconds without an answer until it stops (CommTimeout).
    """

    model: str = "irb1600_10_145"
    host: str = "127.0.0.6"
    computer: str = "127.0.0.1:6510"
    cycle_ms: Annotated[int, Parameter(validator=Number(gte=4, lte=96, modulo=4))] = 4
    timeout_s: Annotated[float, Parameter(validator=Number(gt=0, lt=inf))] = 1.0
    home_deg: SixAngles = (37, 30, -30, 112, -100, 104)


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class FanucOptions(CyclicOptions):
    """Options of a FANUC controller.

    Parameters
    ----------
    patience
        Commands in a row that may be missing: it goes on as before, and then stops.
    j3_from_horizontal
        Whether its J3 counts from the horizontal, as its pendant's does.
    """

    model: str = "m10ia"
    host: str = "127.0.0.7"
    cycle_ms: Annotated[int, Parameter(validator=Number(gte=2, lte=32))] = 8
    patience: Annotated[int, Parameter(validator=Number(gte=0))] = 9
    j3_from_horizontal: bool = False
    home_deg: SixAngles = (93, 22, -9, -119, 90, 65)
