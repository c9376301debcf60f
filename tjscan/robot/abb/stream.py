"""What each message of an ABB controller is answered: the joint angles it guides the arm to."""

from __future__ import annotations

from typing import Final

import numpy as np

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.robot.abb import packets
from tjscan.robot.abb.packets import EgmPacket
from tjscan.robot.cyclic.stream import MOST_LOST, PENDANT_ADVICE, CyclicStream

UNHEARD_LIMIT: Final = 0.15
"""Seconds for which an arm stands before EGM ends, if the controller heard nothing: no lag is."""

LONGEST_LAG: Final = 0.1
"""Seconds that an arm may lag behind what it is sent, an assumption."""


class GuidanceStream(CyclicStream[EgmPacket]):
    """Stream of joint angles to one controller; see `CyclicStream`.

    EGM does not report which answers it took. That they are lost shows by the arm, which stands
    while motors, program and EGM run.
    """

    session, stamp_name = "EGM", "seqno"
    standing_distance = np.radians(0.1)

    def _parse(self, data: bytes) -> EgmPacket:
        return packets.parse_packet(data)

    def _format(self, command: Array, packet: EgmPacket, *, stop: bool) -> bytes:
        return packets.format_answer(command, packet)

    def _unready_reason(self, packet: EgmPacket) -> str | None:
        if packet.motors == packets.MOTORS_OFF:
            return "with motors off (an emergency stop, or switched off)"
        return None if packet.egm == packets.MCI_RUNNING else "before EGM ran"

    def _reported_fault(self, packet: EgmPacket) -> errors.ArmFault | None:
        if packet.motors == packets.MOTORS_OFF:
            return errors.ProtectiveStop(
                "the motors of the arm are off: an emergency or protective stop, or they were "
                f"switched off. {PENDANT_ADVICE}"
            )
        if packet.rapid == packets.RAPID_STOPPED:
            return errors.ProgramStopped(
                f"the RAPID program on the arm's controller is stopped. {PENDANT_ADVICE}"
            )
        if packet.egm != packets.MCI_RUNNING:
            return errors.ProgramStopped(f"EGM has ended on the arm's controller. {PENDANT_ADVICE}")
        return None

    def _standing_fault(self) -> errors.ArmFault:
        return self._lost_answers_fault()

    @property
    def _standing_limit(self) -> float:
        """Seconds until the path has gone on too far from an arm that hears nothing."""
        return LONGEST_LAG + MOST_LOST * self._cycle

    def _answers_are_lost(self) -> bool:
        return self._unheard * self._cycle > UNHEARD_LIMIT
