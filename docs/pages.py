"""Pages of the documentation that are made when it is built: from root files and from code."""

from __future__ import annotations

import re
from collections.abc import Iterator
from json import dumps
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

from tjscan.cli import add_commands_of_packages, app
from tjscan.cli.files import json_schema_of_kind
from tjscan.job.reading import FILE_KINDS, FileKind

ROOT = Path(__file__).parents[1]

MODULES = {
    "tjscan": ("`import tjscan`", ["tjscan.api"]),
    "results": (
        "What the functions return",
        [
            "tjscan.groove.section.GrooveSection",
            "tjscan.groove.measured.MeasuredSection",
            "tjscan.result.summary.ScanSummary",
            "tjscan.laser.profile.Profile",
            "tjscan.comparison.compare.Comparison",
            "tjscan.comparison.compare.DeviationDistances",
            "tjscan.calibration.result.HandEyeCalibration",
            "tjscan.core.frames",
        ],
    ),
    "devices": (
        "Devices and their drivers",
        [
            "tjscan.robot.arm",
            "tjscan.robot.drivers",
            "tjscan.laser.line_laser",
            "tjscan.laser.drivers",
            "tjscan.vehicle.vehicle",
            "tjscan.vehicle.drivers",
            "tjscan.vehicle.localisation",
            "tjscan.vehicle.drivers",
            "tjscan.core.devices",
        ],
    ),
    "errors": ("Errors", ["tjscan.core.errors"]),
}
"""Pages of docstrings: the title of each, and its modules or classes."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the files of the checkout's root, and the reference."""
    made = {"index.md": (ROOT / "README.md").read_text(encoding="utf-8")}
    for name in (
        "CHANGELOG.md",
        "CONTRIBUTING.md",
        "SECURITY.md",
        "examples/first-scan.ipynb",
    ):
        made[name] = (ROOT / name).read_text(encoding="utf-8")
    made = {name: text.replace("](docs/", "](") for name, text in made.items()}
    made["reference/commands.md"] = _page_of_commands()
    for kind in FILE_KINDS:
        made[f"reference/files/{kind.word}.md"] = "\n".join(_page_of_schema(kind))
    for page, (title, modules) in MODULES.items():
        blocks = [f"## {_heading(name)}\n\n::: {name}\n" for name in modules]
        made[f"reference/{page}.md"] = "\n".join([f"# {title}\n", *blocks])
    for name, text in made.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Let links to the checkout's root lead to its pages here."""
    return markdown.replace("](../", "](")


def on_post_build(config: MkDocsConfig) -> None:
    """Refuse a page that would fetch anything from elsewhere when it is opened."""
    outside = re.compile(r'<(?:script|link|img|iframe)\b[^>]*(?:src|href)="?(?:https?:)?//[^>]*')
    for page in sorted(Path(config.site_dir).rglob("*.html")):
        if found := outside.search(page.read_text(encoding="utf-8")):
            raise PluginError(f"{page.name} would fetch from elsewhere: {found[0]}")


def _heading(name: str) -> str:
    """Name of a module, or of a class without its module."""
    last = name.rpartition(".")[2]
    return last if last[0].isupper() else name


def _page_of_commands() -> str:
    """A page of all commands and their options."""
    add_commands_of_packages()
    head, _, commands = app.generate_docs().partition("## Table of Contents")
    return head.replace("# tjscan", "# The command line", 1) + commands[commands.index("\n## ") :]


def _page_of_schema(kind: FileKind) -> Iterator[str]:
    """A page of all keys of a kind of file."""
    schema = json_schema_of_kind(kind)
    name = kind.name.partition(" ")[2]
    yield f"# {name[0].upper()}{name[1:]}\n"
    yield f"{kind.use[0].upper()}{kind.use[1:]}.\n"
    yield f"`tjscan schema {kind.word}` prints this for editors.\n"
    yield from _table(schema, schema.get("$defs", {}), ())


def _table(
    table: dict[str, Any], defined: dict[str, Any], path: tuple[str, ...], *, many: bool = False
) -> Iterator[str]:
    """The keys of a table, and after it the tables inside it."""
    inside = []
    rows = ["| key | what it is | value | if left out |", "| --- | --- | --- | --- |"]
    for key, value in table["properties"].items():
        kinds = [_resolved(one, defined) for one in (value, *value.get("anyOf", ()))]
        rest = [one for one in kinds if one.get("type") != "null" and "anyOf" not in one]
        tables = [one.get("items", one) for one in rest]
        tables = [found for one in tables if "properties" in (found := _resolved(one, defined))]
        if tables:
            inside.append((tables[0], (*path, key), "items" in rest[0]))
            continue
        said = value.get("description", "").replace("|", "\\|")
        known = "must be given" if key in table.get("required", ()) else _word(value.get("default"))
        rows.append(f"| `{key}` | {said} | {', '.join(_bounds(rest))} | {known} |")
    if not table["properties"]:
        return
    if path:
        name = ".".join(path)
        yield f"## `{f'[[{name}]]' if many else f'[{name}]'}`\n"
    yield f"{table.get('description', '')}\n"
    if len(rows) > 2:
        yield "\n".join([*rows, ""])
    for inner, its_path, is_list in inside:
        yield from _table(inner, defined, its_path, many=is_list)


def _resolved(schema: dict[str, Any], defined: dict[str, Any]) -> dict[str, Any]:
    """A schema, or what it refers to."""
    return defined[schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema


def _bounds(kinds: list[dict[str, Any]]) -> Iterator[str]:
    """What values a key takes, in words."""
    for kind in kinds:
        if "enum" in kind:
            yield " or ".join(f"`{_word(value)}`" for value in kind["enum"])
            continue
        words = {"number": "number", "integer": "whole number", "boolean": "true or false"}
        words |= {"string": "text", "array": "list", "object": "table"}
        least, most = kind.get("minimum"), kind.get("maximum")
        above = kind.get("exclusiveMinimum")
        said = [words.get(kind.get("type", ""), "any")]
        said += [f"from {least:g}"] if least is not None else []
        said += [f"more than {above:g}"] if above is not None else []
        said += [f"to {most:g}"] if most is not None else []
        yield " ".join(said)


def _word(value: Any) -> str:
    """A value as a file writes it; nothing for none."""
    return "" if value is None else dumps(value, ensure_ascii=False).strip('"')
