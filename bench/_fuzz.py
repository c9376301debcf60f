"""Spoiled files for every reader: what comes out has to be an answer or an error of the tree."""

from __future__ import annotations

import json
import random
import re
import resource
import struct
import time
import tomllib
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from zlib import crc32

import tomli_w

from tjscan.core.errors import TjscanError

NUMBER: Final = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
ODD_NUMBERS: Final = (
    *(b"nan", b"inf", b"-inf", b"-1", b"0", b"-0.0", b"1e308", b"-1e308", b"1e-320", b"1e999"),
    *(b"2147483648", b"4294967296", b"18446744073709551616", b"99999999999999999999999999"),
    *(b"", b"abc", b"true", b"[]", b"{}", b"'x'", b'"x"', b"0x10", b"1_000", b"1,5", b"1 2"),
    *(b"7" * 5000, b"-" * 40, b"\xff\xfe", b"\x00", "½".encode(), b"None", b"null", b"1e5"),
)
"""What takes the place of a number in a text."""
ODD_BYTES: Final = (
    *(b"[" * 3000, b"{" * 3000, b"a." * 3000 + b"b = 1\n", b'"' * 3, b"'''", b"\r", b"\n\n\n"),
    *(b"../../../../etc/passwd", b"\x00" * 64, b"\xef\xbb\xbf", b"\xff" * 9, b",,,,,,", b"#", b"="),
    *(b"x" * 20_000, b"\n[[a]]" * 400, b"end_header\n", b"nan nan nan\n", b"1 1 1\n" * 200),
)
"""What is put somewhere."""
ODD_VALUES: Final[tuple[Any, ...]] = (
    *(0, -1, 1, 2**63, -(2**63), 10**30, 1e308, -1e308, 1e-320, float("nan"), float("inf"), True),
    *("", "x", "\x00", "../../../../etc/passwd", "/dev/zero", "x" * 5000, "½\U0001f600", "nan"),
    *([], {}, [[]], [1.0] * 3, [1.0] * 2000, [[1.0, 2.0]] * 40, {"x": 1}, [{}], ["a"], [[[[[1]]]]]),
)
"""What takes the place of a value in a table."""


CHUNK_HEAD: Final = 40
"""Bytes that stand before the records of an uncompressed chunk."""


@dataclass(frozen=True, slots=True)
class Reader:
    """A reader, and whole files that it reads.

    Parameters
    ----------
    name : str
        What it reads.
    file : str
        Name of the file, which says its kind.
    seeds : tuple of bytes
        Whole files.
    read : callable
        Reads a file.
    share : float
        Of all inputs, in proportion to those of the other readers.
    """

    name: str
    file: str
    seeds: tuple[bytes, ...]
    read: Callable[[Path], object]
    share: float = 1.0


@dataclass(slots=True)
class Tally:
    """What became of many inputs.

    Parameters
    ----------
    inputs, read, refused : int
        How many, and of them how many were read all the same, or refused by an error of the tree.
    slowest : float
        Seconds of the slowest.
    grown : int
        Bytes by which the process grew.
    wrong : list of (bytes, str)
        Inputs that ended otherwise, and how.
    """

    inputs: int = 0
    read: int = 0
    refused: int = 0
    slowest: float = 0.0
    grown: int = 0
    wrong: list[tuple[bytes, str]] = field(default_factory=list)


def fuzz(
    reader: Reader,
    count: int,
    seed: int,
    folder: Path,
    before: Callable[[bytes], None] = lambda _: None,
) -> Tally:
    """Give a reader `count` spoiled files; the same seed spoils them in the same way.

    Parameters
    ----------
    folder : Path
        Where the files are put, one after another.
    before : callable
        Is told of each input before it is read.
    """
    dice, tally = random.Random(f"{reader.name} {seed}"), Tally()
    start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    file = folder / reader.file
    for _ in range(count):
        data = spoiled(dice, reader.seeds)
        before(data)
        file.write_bytes(data)
        began = time.perf_counter()
        try:
            reader.read(file)
            tally.read += 1
        except TjscanError:
            tally.refused += 1
        except Exception:
            tally.wrong.append((data, traceback.format_exc()))
        tally.slowest = max(tally.slowest, time.perf_counter() - began)
        tally.inputs += 1
    tally.grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - start)
    return tally


def spoiled(dice: random.Random, seeds: Sequence[bytes]) -> bytes:
    """A whole file with one thing or a few things wrong."""
    data = dice.choice(seeds)
    kinds = [_flip, _cut, _drop, _twice, _put, _number, _number, _number]
    if data.startswith(b"\x89MCAP"):
        kinds += [_length, _length, _message, _chunk, _chunk, _chunk, _chunk]
    elif b" = " in data:
        kinds += [_table] * 5
    elif data.lstrip().startswith(b"{"):
        kinds += [_json_line] * 4
    for _ in range(1 + (dice.random() < 0.3) + 3 * (dice.random() < 0.1)):
        data = dice.choice(kinds)(dice, data)
    if dice.random() < 0.02:
        data = _splice(dice, data, dice.choice(seeds))
    return data


def _place(dice: random.Random, data: bytes) -> int:
    return dice.randrange(len(data) + 1)


def _flip(dice: random.Random, data: bytes) -> bytes:
    spoilt = bytearray(data)
    for _ in range(min(len(spoilt), dice.choice((1, 1, 2, 8)))):
        spoilt[dice.randrange(len(spoilt))] = dice.randrange(256)
    return bytes(spoilt)


def _cut(dice: random.Random, data: bytes) -> bytes:
    return data[: _place(dice, data)]


def _drop(dice: random.Random, data: bytes) -> bytes:
    start = _place(dice, data)
    return data[:start] + data[start + dice.choice((1, 2, 9, 64, 1000)) :]


def _twice(dice: random.Random, data: bytes) -> bytes:
    start = _place(dice, data)
    part = data[start : start + dice.choice((1, 9, 64, 1000))]
    return data[:start] + dice.choice((1, 1, 30)) * part + data[start:]


def _put(dice: random.Random, data: bytes) -> bytes:
    start = _place(dice, data)
    return data[:start] + dice.choice(ODD_BYTES) + data[start:]


def _number(dice: random.Random, data: bytes) -> bytes:
    # From some place on: finding all numbers of a large file takes longer than reading it.
    found = NUMBER.search(data, dice.randrange(max(1, len(data))) if dice.random() < 0.7 else 0)
    if found is None:
        return data
    return data[: found.start()] + dice.choice(ODD_NUMBERS) + data[found.end() :]


def _splice(dice: random.Random, data: bytes, other: bytes) -> bytes:
    return data[: _place(dice, data)] + other[_place(dice, other) :]


def _table(dice: random.Random, data: bytes) -> bytes:
    """TOML with a value replaced, a key gone, or a key too many."""
    try:
        table = tomllib.loads(data.decode())
        _spoil(dice, table)
        return tomli_w.dumps(table).encode()
    except (ValueError, TypeError, RecursionError):
        return data


def _json_line(dice: random.Random, data: bytes) -> bytes:
    """The same for a line of JSON, or for all of it."""
    lines = data.split(b"\n") if data.count(b"\n{") else [data]
    i = dice.randrange(len(lines))
    try:
        table = json.loads(lines[i])
        _spoil(dice, table)
        lines[i] = json.dumps(table).encode()
    except (ValueError, TypeError, RecursionError):
        return data
    return b"\n".join(lines)


def _spoil(dice: random.Random, table: Any) -> None:
    """Replace, remove or add one thing in a nest of tables and lists."""
    while True:
        keys = list(table) if isinstance(table, dict) else list(range(len(table)))
        if not keys:
            return
        key = dice.choice(keys)
        inner = table[key]
        if isinstance(inner, dict | list) and inner and dice.random() < 0.75:
            table = inner
            continue
        act = dice.random()
        if act < 0.7:
            table[key] = dice.choice(ODD_VALUES)
        elif act < 0.85:
            del table[key]
        elif isinstance(table, dict):
            table[dice.choice(("x", "", "\x00", "a.b", *map(str, keys)))] = dice.choice(ODD_VALUES)
        else:
            table.append(dice.choice(ODD_VALUES))
        return


def _records(data: bytes) -> list[tuple[int, int, bytes]]:
    """Place, opcode and content of the records of an MCAP file."""
    found, at = [], 8
    while at + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        if length > len(data):
            break
        found.append((at, opcode, data[at + 9 : at + 9 + length]))
        at += 9 + length
    return found


def section_ends(data: bytes) -> list[int]:
    """Where in an MCAP file each finished section ends: the chunk, or the record, that holds it."""
    channels: dict[int, bytes] = {}
    ends = []
    for at, opcode, content in _records(data):
        inner = _records(bytes(8) + content[CHUNK_HEAD:]) if opcode == 6 else [(0, opcode, content)]
        for _, kind, body in inner:
            (number,) = struct.unpack_from("<H", body) if kind in (4, 5) else (0,)
            if kind == 4:
                (length,) = struct.unpack_from("<I", body, 4)
                channels[number] = body[8 : 8 + length]
            elif kind == 5 and channels[number] == b"/section":
                ends.append(at + 9 + len(content))
    return ends


def _length(dice: random.Random, data: bytes) -> bytes:
    """A record that lies about its length, or about its kind."""
    records = _records(data)
    if not records:
        return data
    at, opcode, content = dice.choice(records)
    lengths = (0, 1, 2**32, 2**62, 2**64 - 1, len(content) + 1, max(0, len(content) - 1), 40)
    if dice.random() < 0.3:
        opcode = dice.randrange(256)
    head = struct.pack("<BQ", opcode, dice.choice((len(content), *lengths)))
    return data[:at] + head + data[at + 9 :]


def _message(dice: random.Random, data: bytes) -> bytes:
    """A message that is whole as a record, and holds something else than it should."""
    records = [one for one in _records(data) if one[1] == 5 and len(one[2]) > 22]
    if not records:
        return data
    at, opcode, content = dice.choice(records)
    change = _json_line if content[22:].startswith(b"{") else _flip
    body = change(dice, content[22:]) if dice.random() < 0.8 else _number(dice, content[22:])
    head = struct.pack("<BQ", opcode, 22 + len(body))
    return data[:at] + head + content[:22] + body + data[at + 9 + len(content) :]


def _chunk(dice: random.Random, data: bytes) -> bytes:
    """A chunk that is whole, its checksum too, whose records are not what they should be."""
    chunks = [one for one in _records(data) if one[1] == 6 and len(one[2]) > CHUNK_HEAD]
    if not chunks:
        return data
    at, _, content = dice.choice(chunks)
    change = dice.choice((_message, _message, _length, _flip, _drop))
    inner = change(dice, bytes(8) + content[CHUNK_HEAD:])[8:]
    head = content[:16] + struct.pack("<QIIQ", len(inner), crc32(inner), 0, len(inner))
    record = struct.pack("<BQ", 6, len(head) + len(inner)) + head + inner
    return data[:at] + record + data[at + 9 + len(content) :]
