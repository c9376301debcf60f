"""Commands about files that people write: examples, schemas and joints."""

from __future__ import annotations

import tomllib
from importlib.metadata import EntryPoint
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from tjscan.cli.output.console import print_message, print_table
from tjscan.core.errors import ConfigurationError, nearest_word

if TYPE_CHECKING:
    from tjscan.job.reading import FileKind


def init(example: str | None = None, *, out: Path | None = None) -> None:
    """Write an example's files, to try and to change: a job, its joint, and their schemas.

    Without an example, they are listed.

    Parameters
    ----------
    example
        Name of the example, such as paper.
    out
        Directory for the files; the working directory if left out. What is there is never
        overwritten; files that examples share are left as they are.
    """
    from tjscan.core.files import write_files_atomically
    from tjscan.job.examples import examples, files_of_example
    from tjscan.job.reading import kind_of_other_file

    if example is None:
        print_table(list(examples().items()))
        return
    folder = Path() if out is None else out
    texts = files_of_example(example)
    kinds = {name: kind_of_other_file(tomllib.loads(text), ()) for name, text in texts.items()}
    for name, kind in kinds.items():
        if kind is not None:
            schema = f"{kind.word}.schema.json"
            texts[name] = f"#:schema ./{schema}\n\n{texts[name]}"
            texts[schema] = dumps(json_schema_of_kind(kind), indent=1)
    job = folder / f"{example}.toml"
    kind_of_job, texts = kinds[job.name], _texts_to_write(folder, texts)
    there = [name for name in texts if (folder / name).exists()]
    if there:
        raise ConfigurationError(
            "is there already, and nothing was written; choose another folder with --out, or "
            "move it away",
            file=folder / there[0],
        )
    with write_files_atomically(folder) as draft:
        for name, text in texts.items():
            (draft / name).write_text(text, encoding="utf-8")
    print_message(f"wrote {', '.join(sorted(texts))}")
    if kind_of_job is not None:
        print_message(f"{job}: {kind_of_job.use}")


def _texts_to_write(folder: Path, texts: dict[str, str]) -> dict[str, str]:
    """Those of an example's texts that are not there already, from another example."""

    def is_there(name: str) -> bool:
        file = folder / name
        return file.is_file() and file.read_bytes() == texts[name].encode()

    missing = {name: text for name, text in texts.items() if not is_there(name)}
    return missing or texts  # an example that is there as a whole was not asked for in vain


MODELS_OF_KINDS: Final = {
    "joint": "tjscan.joint.file:JointFile",
    "chain": "tjscan.runs.chain:ChainFile",
    "scan": "tjscan.job.files:ScanJob",
    "weld": "tjscan.job.weld:WeldJob",
    "crawl": "tjscan.job.crawl.job:CrawlJob",
    "tow": "tjscan.job.tow.job:TowJob",
    "recorded": "tjscan.job.files:RecordedJob",
    "accept": "tjscan.job.files:AcceptanceJob",
    "calibrate": "tjscan.job.files:CalibrationJob",
    "study": "tjscan.study.file:StudyFile",
    "wps": "tjscan.planning.wps:WeldingProcedure",
}
"""Model of each of `tjscan.job.reading.FILE_KINDS`, by its word: it is imported when it is used."""


def schema(kind: str | None = None) -> None:
    """Print the JSON schema of a kind of file, for editors that complete and check TOML files.

    A file names its schema in its first line: ``#:schema ./scan.schema.json``. Without a kind, the
    kinds are listed.

    Parameters
    ----------
    kind
        The kind of file, such as scan.
    """
    from tjscan.job.reading import FILE_KINDS

    if kind is None:
        print_table([(found.word, found.name, found.use) for found in FILE_KINDS])
        return
    kinds = {found.word: found for found in FILE_KINDS}
    if kind not in kinds:
        raise ConfigurationError(
            f"there is no kind of file {kind!r}; did you mean: {nearest_word(kind, list(kinds))}? "
            f"Known: {', '.join(kinds)}"
        )
    print(dumps(json_schema_of_kind(kinds[kind]), indent=1))


def json_schema_of_kind(kind: FileKind) -> dict[str, Any]:
    """The JSON schema of files of a kind."""
    from pydantic import TypeAdapter

    from tjscan.core.json_schema import SCHEMA_DIALECT

    model = EntryPoint(kind.word, MODELS_OF_KINDS[kind.word], "tjscan.file").load()
    return {"$schema": SCHEMA_DIALECT} | TypeAdapter(model).json_schema() | {"title": kind.name}


def joint(file: Path, *, out: Path | None = None, json: bool = False) -> None:
    """Build a joint's mesh (STL and PLY, in mm) and its groove's edges.

    Parameters
    ----------
    file
        The joint's definition (TOML).
    out
        The folder to write to; ``build/NAME`` beside the definition if left out.
    json
        Print what was built as JSON on stdout.
    """
    from tjscan.joint.export import build_and_write_joint
    from tjscan.joint.file import read_joint

    definition = read_joint(file)
    directory = out or file.parent / "build" / definition.name
    built = build_and_write_joint(definition, directory)
    if json:
        print(built.model_dump_json(indent=2))
        return
    chord = f"{1e3 * built.chord_error_mm:.1f} µm"
    print_message(f"{directory}: {built.triangles} triangles, within {chord} of the true surfaces")
