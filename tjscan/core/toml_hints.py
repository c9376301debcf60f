"""What a mistake in a TOML file most likely is, in one line with what to write instead."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import degrees
from typing import Any, Final

BYTE_ORDER_MARKS: Final = {b"\xef\xbb\xbf": "UTF-8", b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}
"""First bytes that some editors write, and the encoding that they mean."""

SYNTAX_HINTS: Final = (
    (r"[“”„‘’]", 'it has typographic quotes: write plain ones, "…"'),
    (r"^(\s*[\w.]+)\s*:", "write = between key and value, not a colon"),
    (r"=\s*([+-]?\d+),(\d+)$", "a decimal comma? Write a point: {0}.{1}"),
    (r"=\s*(True|False|yes|no|on|off)$", "write true or false"),
    (r'=\s*"[^"]*\\', "a backslash begins a control code: write / in paths, or single quotes"),
    (r"=\s*([+-]?[\d.]+)\s*[^\W\d]+", "write the number alone, {0}; the key states the unit"),
    (r"=\s*([^\W\d][^\s\"']*)$", 'text is written in quotes: "{0}"'),
)
"""Patterns of a line that is no TOML, and what each most likely means."""

OTHER_UNITS: Final[dict[str, tuple[tuple[str, float], ...]]] = {
    "mm": (("metres", 1e3), ("micrometres", 1e-3)),
    "mm_s": (("metres per second", 1e3), ("metres per minute", 1e3 / 60)),
    "mm_s2": (("metres per second squared", 1e3),),
    "deg": (("radians", degrees(1.0)),),
    "deg_s": (("radians per second", degrees(1.0)),),
    "m": (("millimetres", 1e-3),),
    "kg": (("grams", 1e-3),),
    "s": (("milliseconds", 1e-3),),
    "ms": (("seconds", 1e3), ("microseconds", 1e-3)),
    "us": (("milliseconds", 1e3), ("seconds", 1e6)),
    "percent": (("a share", 1e2),),
    "m_min": (("millimetres per second", 0.06),),
    "kg_m": (("grams per metre", 1e-3),),
    **dict.fromkeys(("n_m", "per_m", "deg_m", "mrad_s"), ()),
}
"""Units that are taken for the one a key ends in, and how many of that one each is; the longest
that a key ends in counts, so a torque's is no length."""


def encoding_hint(content: bytes) -> str | None:
    """Hint about the encoding that a file's first bytes state; None if they state none."""
    name = next((n for mark, n in BYTE_ORDER_MARKS.items() if content.startswith(mark)), None)
    if name is None:
        return None
    return f"begins with a byte order mark (BOM) of {name}: save it as UTF-8 without BOM"


def syntax_hint(text: str, message: str) -> str:
    """Hint about the line that a message of `tomllib` names; empty if nothing is recognised."""
    if "overwrite" in message or "twice" in message:
        return "; it is there twice: delete one"
    number = re.search(r"line (\d+)", message)
    lines = text.splitlines()
    if number is None or not 0 < int(number[1]) <= len(lines):
        return ""
    line = re.sub(r"\s+#[^\"']*$", "", lines[int(number[1]) - 1]).strip()
    hints = (
        hint.format(*found.groups())
        for pattern, hint in SYNTAX_HINTS
        if (found := re.search(pattern, line))
    )
    return f": {line:.80}: {next(hints, 'not understood')}"


def unit_hint(key: str, value: Any, least: float | None, most: float | None) -> str:
    """Hint about a number beyond its bounds that is within them in another unit.

    Parameters
    ----------
    key : str
        Which ends in its unit, such as ``step_mm``.
    value : Any
        What was found.
    least, most : float, optional
        The bound that it is beyond.

    Returns
    -------
    str
        With what to write; empty if no other unit would do.
    """
    units = [unit for unit in OTHER_UNITS if key.endswith(f"_{unit}")]
    if not units or type(value) not in (int, float):
        return ""
    for name, factor in OTHER_UNITS[max(units, key=len)]:
        meant = float(f"{value * factor:.6g}")
        if (least is not None and factor > 1 and abs(value) < least <= abs(meant)) or (
            most is not None and factor < 1 and meant <= most
        ):
            return f"; {value:g} looks like {name}: write {meant}"
    return ""


def list_hint(found: Any, wanted: int) -> str:
    """Hint about a list that has more numbers than are wanted."""
    if not isinstance(found, Sequence) or isinstance(found, str):
        return ""
    pose = "a position and a rotation have a key each: position_mm and euler_zyx_deg"
    if all(type(one) is int for one in found):
        hint = "; decimal commas? Write points"
        if len(found) == 2 * wanted and min(found[1::2]) >= 0:
            meant = ", ".join(f"{a}.{b}" for a, b in zip(found[::2], found[1::2], strict=True))
            hint = f"{hint}: [{meant}]"
        return f"{hint}; or {pose}" if (len(found), wanted) == (6, 3) else hint
    if (len(found), wanted) == (6, 3):
        return f"; {pose}"
    if (len(found), wanted) == (4, 3):
        return "; a quaternion? Write its three Z-Y-X Euler angles in degrees: [rz, ry, rx]"
    return ""


def number_hint(found: Any) -> str:
    """Hint about a text where a number is wanted."""
    if not isinstance(found, str):
        return ""
    plain = found.strip().replace(",", ".")
    return f"; write {plain}, without quotes" if re.fullmatch(r"[+-]?\d+\.?\d*", plain) else ""
