"""Hold the weight of the program against the table in ``weight.toml``.

Prints, for every room of ``tjscan/``, its code lines and files, then the whole program's small
files, the files on a profile's way, module constants of one bare word (the loopback's, too), and
words that the texts avoid; ends with 1 if a figure is larger than its entry. Lower an entry
whenever a change makes it possible; raise one only with a reason as a comment beside it.
``--write`` lowers the entries to what is measured and keeps their comments.

Code lines are lines that are neither blank nor comment nor docstring.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
import tomllib
from collections import defaultdict
from pathlib import Path
from typing import Final

from profile_way import trace_profile_way

ROOT: Final = Path(__file__).parents[1]
PROGRAM: Final = ROOT / "tjscan"
LOOPBACK: Final = ROOT / "loopback"
TABLE_FILE: Final = Path(__file__).with_name("weight.toml")

UNIT_SYMBOLS: Final = frozenset(
    {
        *("MM", "MM2", "DEG", "KG", "MRAD", "NEWTON"),
        *("SECONDS", "MILLISECONDS", "MICROSECONDS", "COLUMNS", "POINTS"),
    }
)
"""Constants that are units, one word each: ``3 * MM`` reads as it is meant."""

SMALL_FILE_LINES: Final = 40
"""A file with fewer code lines is a fragment more often than a concept."""

NO_CODE: Final = frozenset(
    {
        *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE),
        *(tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER),
    }
)

AVOIDED_WORDS: Final = re.compile(
    r"\b(nobody|whoever|somebody|anew|gainsays?|once more|seldom)\b", re.IGNORECASE
)
"""Words that a first reading stumbles over; see CONTRIBUTING.md."""


def code_lines(source: str) -> int:
    """Number of lines that are neither blank nor comment nor docstring."""
    docstrings: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                docstrings.update(range(first.lineno, (first.end_lineno or 0) + 1))
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in NO_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - docstrings)


def one_word_constants(source: str) -> list[str]:
    """Module constants of one bare word; unit symbols and type variables of one letter aside."""
    found = []
    for node in ast.parse(source).body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AnnAssign):
            targets = [node.target]
        targets = [one for target in targets for one in getattr(target, "elts", [target])]
        names = [target.id.strip("_") for target in targets if isinstance(target, ast.Name)]
        found += [name for name in names if len(name) > 1 and name.isupper() and "_" not in name]
    return [name for name in found if name not in UNIT_SYMBOLS]


def measure() -> dict[str, dict[str, int]]:
    """Measure everything that the table holds."""
    lines: defaultdict[str, int] = defaultdict(int)
    files: defaultdict[str, int] = defaultdict(int)
    whole = {"code_lines": 0, "files": 0, "files_under_40_lines": 0, "one_word_constants": 0}
    for file in sorted(PROGRAM.rglob("*.py")):
        source, place = file.read_text(encoding="utf-8"), file.relative_to(PROGRAM)
        room = place.parts[0] if len(place.parts) > 1 else "root"
        count = code_lines(source)
        lines[room] += count
        files[room] += 1
        whole["code_lines"] += count
        whole["files"] += 1
        small = count < SMALL_FILE_LINES and file.name != "__init__.py"
        whole["files_under_40_lines"] += small
    for file in sorted([*PROGRAM.rglob("*.py"), *LOOPBACK.rglob("*.py")]):
        for name in one_word_constants(file.read_text(encoding="utf-8")):
            whole["one_word_constants"] += 1
            print(f"{file.relative_to(ROOT)}: {name} is one bare word", file=sys.stderr)
    whole["avoided_words"] = count_avoided_words()
    way = trace_profile_way()
    whole["files_on_a_profiles_way"] = len(way.files)
    whole["changes_of_file_on_a_profiles_way"] = way.file_changes
    return {"code_lines": dict(lines), "files": dict(files), "program": whole}


def count_avoided_words() -> int:
    """Count avoided words in program and documents, naming their places."""
    texts = [*PROGRAM.rglob("*.py"), *(ROOT / "docs").glob("*.md"), *ROOT.glob("*.md")]
    count = 0
    for file in sorted(texts):
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
            for word in AVOIDED_WORDS.findall(line):
                count += 1
                print(f"{file.relative_to(ROOT)}:{number}: {word!r}", file=sys.stderr)
    return count


def write_lower(measured: dict[str, dict[str, int]]) -> None:
    """Lower the table's entries to what is measured; keep its comments."""
    text, part = [], ""
    for line in TABLE_FILE.read_text(encoding="utf-8").splitlines():
        part = line.strip("[]") if line.startswith("[") else part
        entry = re.match(r"(\w+) = (\d+)(.*)", line)
        if entry:
            name, limit, comment = entry[1], int(entry[2]), entry[3]
            line = f"{name} = {min(limit, measured[part].get(name, 0))}{comment}"
        text.append(line)
    TABLE_FILE.write_text("\n".join(text) + "\n", encoding="utf-8")


def main() -> int:
    """Measure, print, and hold against the table."""
    measured = measure()
    if "--write" in sys.argv[1:]:
        write_lower(measured)
    limits = tomllib.loads(TABLE_FILE.read_text(encoding="utf-8"))
    status = 0
    for part, entries in measured.items():
        print(f"{part}")
        for name, value in sorted(entries.items()):
            limit = limits[part].get(name, 0)
            over = value > limit
            status |= over
            print(f"  {name:<36} {value:>6}  ≤ {limit:<6} {'TOO HEAVY' if over else ''}".rstrip())
    if status:
        print(f"lighten the change, or raise the entry in {TABLE_FILE.name} with its reason")
    return int(status)


if __name__ == "__main__":
    sys.exit(main())
