"""What each packet of a KUKA controller is answered: corrections of the joint angles."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.robot.cyclic.stream import PENDANT_ADVICE, CyclicStream
from tjscan.robot.kuka import packets
from tjscan.robot.kuka.packets import RobPacket

START_TOLERANCE: Final = np.radians(0.1)
"""Radians between measured joint angles and the set-point, where nothing was corrected yet."""


class CorrectionStream(CyclicStream[RobPacket]):
    """Stream of corrections to one controller; see `CyclicStream`.

    Parameters
    ----------
    host : str
        Its IP address; packets of others are ignored.
    sen_type : str
        What its configuration calls this program.
    cycle : float
        Seconds between two packets.
    """

    session, stamp_name = "RSI", "IPOC"
    stamps = 10**packets.LONGEST_TIME_STAMP
    standing_causes = (
        ": an emergency or protective stop, its drives are off, or a limit of its RSI context "
        "holds it"
    )

    def __init__(self, host: str, sen_type: str, cycle: float) -> None:
        super().__init__(host, cycle, period=round(1e3 * cycle))
        self._sen_type = sen_type

    def _parse(self, data: bytes) -> RobPacket:
        return packets.parse_packet(data)

    def _format(self, command: Array, packet: RobPacket, *, stop: bool) -> bytes:
        correction = command - self._base
        return packets.format_answer(self._sen_type, correction, packet.stamp, stop=stop)

    def _first_fault(self, packet: RobPacket) -> errors.ArmFault | None:
        if not packet.late and np.abs(packet.q - packet.set_point).max() <= START_TOLERANCE:
            return None
        return errors.ArmNotConnected(
            "RSI ran on the arm's controller before this program listened, and may have "
            "corrected the arm already. End the program on its pendant, and start it once "
            "this program waits for it."
        )

    def _reported_fault(self, packet: RobPacket) -> errors.ArmFault | None:
        if packet.program in (None, packets.PROGRAM_ACTIVE):
            return None
        return errors.ProgramStopped(
            "the RSI program on the arm's controller is stopped or has ended (its interpreter's "
            f"state is {packet.program}). {PENDANT_ADVICE}"
        )
