"""What each status packet of a FANUC controller is answered: the joint angles of the next cycle."""

from __future__ import annotations

from tjscan.core import errors
from tjscan.core.frames import Array
from tjscan.robot.cyclic.stream import PENDANT_ADVICE, CyclicStream
from tjscan.robot.fanuc import packets
from tjscan.robot.fanuc.packets import StatusPacket


class MotionStream(CyclicStream[StatusPacket]):
    """Stream of joint angles to one controller; see `CyclicStream`.

    Parameters
    ----------
    host : str
        Its IP address; packets of others are ignored.
    cycle : float
        Seconds between two packets.
    smoothing : float
        Seconds within which an acceleration builds up: the controller limits the jerk.
    """

    session, stamp_name = "stream motion", "number"
    holds_when_unanswered = False

    def __init__(self, host: str, cycle: float, smoothing: float) -> None:
        super().__init__(host, cycle, smoothed=max(round(smoothing / cycle), 1))
        self._capable = self._heard = self._greeted = self._acknowledges = False

    def answer(self, data: bytes, sender: tuple[str, int]) -> bytes | None:
        """Answer to a packet; None if it is not answered."""
        if self.is_from_controller(sender) and len(data) == packets.CAPABILITY_FORMAT.size:
            kind, _, _, cycle_ms, _, _, of_tool = packets.CAPABILITY_FORMAT.unpack(data)
            if kind == packets.READ_CAPABILITY:
                self._take_capability(cycle_ms, of_tool)
                return None
        return super().answer(data, sender)

    def greetings(self) -> list[bytes]:
        """What makes the controller send, as long as it does not."""
        ask = [] if self._capable else [packets.CAPABILITY_REQUEST]
        end = [] if self._greeted else [packets.STOP_PACKET]  # a session of an earlier program
        self._greeted = True
        return ask if self._heard else [*end, *ask, packets.START_PACKET]

    def farewells(self) -> list[bytes]:
        """What ends the session after the last answer."""
        return [packets.STOP_PACKET] if self.connected else []

    def _take_capability(self, cycle_ms: int, of_tool: int) -> None:
        self._capable = True
        if of_tool or abs(1e-3 * cycle_ms - self._cycle) > 1e-6:
            self.fail(
                errors.ArmNotConnected(
                    f"the arm's controller sends a packet every {cycle_ms} ms, with the pose of "
                    f"its {'tool' if of_tool else 'face plate'}, where cycle_ms = "
                    f"{1e3 * self._cycle:g} and the face plate's pose are expected"
                ),
                silent=True,
            )

    def _parse(self, data: bytes) -> StatusPacket:
        return packets.parse_status(data, self._cycle)

    def _format(self, command: Array, packet: StatusPacket, *, stop: bool) -> bytes:
        return packets.format_command(command, packet.stamp, last=stop)

    def _unready_reason(self, packet: StatusPacket) -> str | None:
        self._heard = True
        if packet.robot_status & packets.EMERGENCY_STOP:
            return "with an emergency stop pressed"
        if packet.robot_status & packets.IN_ERROR:
            return "with its controller in error"
        if not self._capable:
            return "before its controller stated its capabilities"
        takes = packet.status & packets.TAKES_COMMANDS
        return None if takes else "before its program took commands"

    def _reported_fault(self, packet: StatusPacket) -> errors.ArmFault | None:
        came = bool(packet.status & packets.COMMAND_CAME)
        self._acknowledges = self._acknowledges or came
        self._late += self._acknowledges and not came
        if packet.robot_status & packets.EMERGENCY_STOP:
            return errors.EmergencyStop(
                f"an emergency stop of the arm is pressed. {PENDANT_ADVICE}"
            )
        if packet.robot_status & packets.IN_ERROR:
            if self._answers_are_lost() or self._lost > 1:
                return self._lost_answers_fault()
            return errors.ProtectiveStop(
                f"the arm's controller has stopped it with an error. {PENDANT_ADVICE}"
            )
        if not packet.status & packets.TAKES_COMMANDS:
            return errors.ProgramStopped(
                "the stream motion program on the arm's controller is stopped or has ended. "
                f"{PENDANT_ADVICE}"
            )
        return None
