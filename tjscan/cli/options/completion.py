"""Shell completion that offers the keys of job files, which are options too."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from inspect import Parameter as PythonParameter
from inspect import Signature
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, get_type_hints

from cyclopts import Parameter

if TYPE_CHECKING:
    from cyclopts import App

JOB_KIND_OF_COMMAND: Final[Mapping[tuple[str, ...], str]] = {
    **{
        (w,): "scan"
        for w in ("scan", "place", "teach", "doctor", "laser", "reprocess", "laser-loopback")
    },
    ("weld",): "weld",
    ("accept",): "accept",
    ("calibrate",): "calibrate",
    **{("crawl", word): "crawl" for word in ("run", "size", "calibrate", "register", "replay")},
    **{("tow", word): "tow" for word in ("run", "replay")},
}
"""Commands that take keys of a job as options, and the kind of that job's file."""


@contextmanager
def job_keys_as_options(app: App) -> Iterator[None]:
    """Let the commands of `JOB_KIND_OF_COMMAND` have an option for each key while the block runs.

    That is for making a script of completion; what such a command does is left out.
    """
    with ExitStack() as stack:
        for path, kind in JOB_KIND_OF_COMMAND.items():
            if path[0] not in app:
                continue  # its package is not installed
            command = app
            for word in path:
                command = command[word]
            function = command.default_command
            stack.callback(setattr, command, "default_command", function)
            command.default_command = _add_option_parameters(function, dict(options_of_job(kind)))
        yield


def options_of_job(kind: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the option of each key of a kind of job, and the words that it may have, if only those.

    Keys of arrays of tables, such as stations, are left out: they contain names.
    """
    from tjscan.cli.files import json_schema_of_kind
    from tjscan.job.reading import FILE_KINDS

    schema = json_schema_of_kind(next(one for one in FILE_KINDS if one.word == kind))
    yield from _options_of_schema(schema, schema.get("$defs", {}), "")


def _options_of_schema(
    schema: Mapping[str, Any], definitions: Mapping[str, Any], before: str
) -> Iterator[tuple[str, tuple[str, ...]]]:
    for name, value in schema.get("properties", {}).items():
        inner = _resolved_schema(value, definitions)
        path = f"{before}{name}".replace("_", "-")
        if "properties" in inner:
            yield from _options_of_schema(inner, definitions, f"{path}.")
        elif before:  # a key outside all tables is no option
            yield f"--{path}", tuple(str(word) for word in inner.get("enum", ()))


def _resolved_schema(
    schema: Mapping[str, Any], definitions: Mapping[str, Any]
) -> Mapping[str, Any]:
    """The schema that a reference leads to, or the first of several that may be."""
    while "$ref" in schema or "anyOf" in schema:
        if "$ref" in schema:
            schema = definitions[schema["$ref"].rpartition("/")[2]]
        else:
            schema = schema["anyOf"][0]
    return schema


def _add_option_parameters(
    function: Callable[..., Any] | None, options: Mapping[str, tuple[str, ...]]
) -> Callable[..., Any]:
    """Function with the parameters of another, and one more for each option."""

    def stand_in(**_: Any) -> None:
        raise NotImplementedError

    if function is None:
        raise LookupError("a group of commands has no options")
    own = Signature.from_callable(function)
    hints = get_type_hints(function, include_extras=True)
    added = {}
    for k, (option, words) in enumerate(options.items()):
        kind: Any = Literal[words] if words else str
        added[f"key_{k}"] = Annotated[kind | None, Parameter(name=option)]
    parameters = [
        *(one.replace(annotation=hints[one.name]) for one in own.parameters.values()),
        *(
            PythonParameter(name, PythonParameter.KEYWORD_ONLY, default=None, annotation=hint)
            for name, hint in added.items()
        ),
    ]
    stand_in.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    stand_in.__annotations__ = {one.name: one.annotation for one in parameters}
    stand_in.__doc__ = function.__doc__
    return stand_in
