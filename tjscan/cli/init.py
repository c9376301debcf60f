"""``tjscan init``."""

from __future__ import annotations

from pathlib import Path


def init(example: str | None = None, *, out: Path | None = None) -> None:
    """Write an example's files, to try and to change: a job, its joint, and their schemas.

    Without an example, they are listed.

    Parameters
    ----------
    example
        Name of the example, such as paper.
    out
        Directory for the files; the working directory if left out. What is there is never
        overwritten.
    """
    import tomllib
    from json import dumps

    from tjscan.cli.output.console import print_message, print_table
    from tjscan.cli.schema import json_schema_of_kind
    from tjscan.core.errors import ConfigurationError
    from tjscan.core.files import write_files_atomically
    from tjscan.job.examples import examples, files_of_example
    from tjscan.job.kinds import kind_of_other_file

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
    job = folder / f"{example}.toml"
    if (kind := kinds[job.name]) is not None:
        print_message(f"{job}: {kind.use}")
