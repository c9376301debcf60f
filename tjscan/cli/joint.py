"""``tjscan joint``."""

from __future__ import annotations

from pathlib import Path


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
    from tjscan.cli.output.console import print_message
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
