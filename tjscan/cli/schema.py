"""``tjscan schema``."""

from __future__ import annotations


def schema(kind: str | None = None) -> None:
    """Print the JSON schema of a kind of file, for editors that complete and check TOML files.

    A file names its schema in its first line: ``#:schema ./scan.schema.json``. Without a kind, the
    kinds are listed.

    Parameters
    ----------
    kind
        The kind of file, such as scan.
    """
    from json import dumps

    from tjscan.cli.output.console import print_table
    from tjscan.core.errors import ConfigurationError, nearest_word
    from tjscan.job.kinds import FILE_KINDS

    if kind is None:
        print_table([(found.word, found.name, found.use) for found in FILE_KINDS])
        return
    kinds = {found.word: found for found in FILE_KINDS}
    if kind not in kinds:
        raise ConfigurationError(
            f"there is no kind of file {kind!r}; did you mean: {nearest_word(kind, list(kinds))}? "
            f"Known: {', '.join(kinds)}"
        )
    print(dumps(kinds[kind].json_schema(), indent=1))
