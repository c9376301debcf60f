"""The registers of a power source behind Modbus, as its manual has them: data in a job."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, Final, Literal

from annotated_types import Ge, Gt, Le, MaxLen, MinLen

from tjscan.core.errors import PowerFault
from tjscan.core.units import (
    LIST_OR_WORD_IN_FILE,
    LITRE_PER_MINUTE,
    M_PER_MIN,
    MILLISECONDS,
    SettingsTable,
)

OrderName = Literal["start", "robot_ready", "gas", "error_reset", "feed", "correction", "job"]
"""What is written: bits and then words."""

StateName = Literal[
    "ready",
    "flow",
    "stable",
    "wire_stuck",
    "error",
    "current",
    "voltage",
    "measured_feed",
    "gas_flow",
    "energy",
]
"""What is read: bits, the error's number, and then measured words."""

ORDER_BITS: Final = ("start", "robot_ready", "gas", "error_reset")
ORDER_WORDS: Final = ("feed", "correction", "job")
STATE_BITS: Final = ("ready", "flow", "stable", "wire_stuck")
STATE_WORDS: Final = ("error", "current", "voltage", "measured_feed", "gas_flow", "energy")
REQUIRED_NAMES: Final = ("start", "feed", "ready", "flow")
"""Without these no arc can be guarded."""

UNIT_FACTORS: Final[Mapping[str, float]] = {
    "feed": M_PER_MIN.factor,
    "measured_feed": M_PER_MIN.factor,
    "gas_flow": LITRE_PER_MINUTE.factor,
}
"""SI value of the unit that a scale counts in: m/min, l/min; else V, A, J."""

WORD_VALUES: Final = 1 << 16

LARGEST_EXCHANGE: Final = 121
"""Registers that one exchange writes at most, as the Modbus protocol limits function 23."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RegisterSettings(SettingsTable):
    """A table [[power.modbus.register]]: where one bit or number is.

    Parameters
    ----------
    name : str
        What it holds.
    word : int
        Address of the register.
    bit : int, optional
        Which of its bits, from 0 for the lowest; a number has none.
    inverted : bool, optional
        Whether the bit is low for yes.
    scale : float, optional
        What one count is: A, V, J, m/min or l/min.
    signed : bool, optional
        Whether the number can be negative.
    range : tuple of float, optional
        Least and most of the number, in the scale's unit: what lies outside is not written, and
        what is read outside while
        current flows stops the arc.
    """

    name: OrderName | StateName
    word: Annotated[int, Ge(0), Le(65535)]
    bit: Annotated[int, Ge(0), Le(15)] | None = None
    inverted: bool = False
    scale: Annotated[float, Gt(0), Le(1e6)] = 1.0
    signed: bool = False
    range: Annotated[tuple[float, ...], MaxLen(2), LIST_OR_WORD_IN_FILE] = ()

    def __post_init__(self) -> None:
        is_bit = self.name in ORDER_BITS + STATE_BITS
        if is_bit != (self.bit is not None):
            raise ValueError(f"{self.name} is {'a bit: it needs bit' if is_bit else 'no bit'}")
        if self.range and not (len(self.range) == 2 and self.range[0] < self.range[1]):
            raise ValueError(f"range of {self.name}: two numbers, the second one larger")

    @property
    def unit_factor(self) -> float:
        """SI value of the unit of `range`."""
        return UNIT_FACTORS.get(self.name, 1.0)

    def check_range(self, value: float) -> None:
        """Refuse a value, SI units, that lies outside.

        Raises
        ------
        PowerFault
            Naming it.
        """
        shown = value / self.unit_factor
        low, high = self.range or (-inf, inf)
        if not low <= shown <= high:
            raise PowerFault(
                f"{self.name} is {shown:.4g}, and power.modbus.register allows {low:g} to {high:g}"
            )

    def encode(self, value: float) -> int:
        """Counts of a value in SI units.

        Raises
        ------
        PowerFault
            If it is out of range, or has no place in a register.
        """
        self.check_range(value)
        counts = round(value / self.unit_factor / self.scale)
        least, most = (-32768, 32767) if self.signed else (0, WORD_VALUES - 1)
        if not least <= counts <= most:
            raise PowerFault(f"{self.name} of {counts} counts has no place in register {self.word}")
        return counts % WORD_VALUES

    def decode(self, counts: int) -> float:
        """Value in SI units of counts."""
        if self.signed and counts >= WORD_VALUES // 2:
            counts -= WORD_VALUES
        return counts * self.scale * self.unit_factor


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantSettings(SettingsTable):
    """A table [[power.modbus.constant]]: a register that always holds the same, such as a mode.

    Parameters
    ----------
    word : int
        Address of the register.
    value : int
        What is written.
    """

    word: Annotated[int, Ge(0), Le(65535)]
    value: Annotated[int, Ge(0), Le(65535)]


Block = tuple[Annotated[int, Ge(0), Le(65535)], Annotated[int, Ge(1), Le(LARGEST_EXCHANGE)]]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModbusPowerSettings(SettingsTable):
    """The table [power.modbus]: how to reach a power source, and where its registers are.

    Parameters
    ----------
    host : str
        Its address.
    port, unit : int
        Of its Modbus server.
    write, read : tuple of int
        First register, and number of registers, of the block that is written and of that which is
        read, in one exchange.
    register : tuple of RegisterSettings
    constant : tuple of ConstantSettings
    timeout : float
        Seconds without an answer after which the link counts as lost.
    frozen : float
        Seconds with current and not one changed measurement after which the registers count as
        frozen: real current is never still.
    """

    host: Annotated[str, MinLen(1)] = "127.0.0.1"
    port: Annotated[int, Ge(1), Le(65535)] = 502
    unit: Annotated[int, Ge(0), Le(255)] = 1
    write: Annotated[Block, LIST_OR_WORD_IN_FILE]
    read: Annotated[Block, LIST_OR_WORD_IN_FILE]
    register: Annotated[tuple[RegisterSettings, ...], MaxLen(40), LIST_OR_WORD_IN_FILE]
    constant: Annotated[tuple[ConstantSettings, ...], MaxLen(40), LIST_OR_WORD_IN_FILE] = ()
    timeout: Annotated[float, Ge(5), Le(1000), MILLISECONDS] = 0.06
    frozen: Annotated[float, Ge(20), Le(10000), MILLISECONDS] = 0.3

    def __post_init__(self) -> None:
        names = [one.name for one in self.register]
        for name in REQUIRED_NAMES:
            if name not in names:
                raise ValueError(f"register: {name} is missing; no arc can be guarded without it")
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"register: {name} is there twice")
        self._refuse_words_outside()
        self._refuse_overlaps()

    def _refuse_words_outside(self) -> None:
        for one in self.register:
            which = "write" if one.name in ORDER_BITS + ORDER_WORDS else "read"
            first, count = self.write if which == "write" else self.read
            if not first <= one.word < first + count:
                raise ValueError(
                    f"register: {one.name} is word {one.word}, and {which} reaches from {first} "
                    f"to {first + count - 1}"
                )
        first, count = self.write
        for constant in self.constant:
            if not first <= constant.word < first + count:
                raise ValueError(f"constant: word {constant.word} is not in the block of write")

    def _refuse_overlaps(self) -> None:
        (a, n), (b, m) = self.write, self.read
        if a < b + m and b < a + n:
            raise ValueError(f"write and read overlap from word {max(a, b)} on")
        taken: dict[tuple[int, int], str] = {}
        for one in self.register:
            bits = range(16) if one.bit is None else (one.bit,)
            _take(taken, one.name, one.word, bits)
        for constant in self.constant:
            _take(taken, "constant", constant.word, range(16))

    @property
    def by_name(self) -> dict[str, RegisterSettings]:
        """Every register by its name."""
        return {one.name: one for one in self.register}

    def encode_orders(self, bits: Mapping[str, bool], words: Mapping[str, float]) -> list[int]:
        """Registers to be written; what the map lacks is left out.

        Raises
        ------
        PowerFault
            If a number is out of its range.
        """
        first, count = self.write
        image = [0] * count
        for constant in self.constant:
            image[constant.word - first] = constant.value
        for one in self.register:
            if one.bit is not None and one.name in bits:
                image[one.word - first] |= (bits[one.name] != one.inverted) << one.bit
            elif one.name in words:
                image[one.word - first] = one.encode(words[one.name])
        return image

    def decode_states(self, image: Sequence[int]) -> tuple[dict[str, bool], dict[str, float]]:
        """Bits, and numbers in SI units, of registers that were read.

        Raises
        ------
        PowerFault
            If there are too few registers, or a number is out of its range while current flows.
        """
        first, count = self.read
        if len(image) != count:
            raise PowerFault(f"{len(image)} registers came where {count} were asked for")
        bits: dict[str, bool] = {}
        words: dict[str, float] = {}
        for one in self.register:
            if one.name in STATE_BITS and one.bit is not None:
                bits[one.name] = bool(image[one.word - first] >> one.bit & 1) != one.inverted
            elif one.name in STATE_WORDS:
                words[one.name] = one.decode(image[one.word - first])
        for name, value in words.items() if bits["flow"] else ():
            self.by_name[name].check_range(value)
        return bits, words


def _take(taken: dict[tuple[int, int], str], name: str, word: int, bits: Sequence[int]) -> None:
    for bit in bits:
        if (other := taken.get((word, bit))) is not None:
            raise ValueError(f"register: {name} and {other} overlap in bit {bit} of word {word}")
        taken[word, bit] = name
