"""The command that places a joint before an arm."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from tjscan.cli.options.shared import JobKeys, parse_overrides
from tjscan.cli.output.console import print_message, print_table
from tjscan.core.errors import ConfigurationError


def place(
    joint: Path,
    arm: str,
    *overrides: JobKeys,
    template: Path | None = None,
    tilt_deg: float = 0.0,
    direction: Literal["counterclockwise", "clockwise"] = "counterclockwise",
    carrier: Path | None = None,
    out: Path | None = None,
) -> None:
    """Find where an arm stands to scan a joint's whole groove, and write the job that does so.

    All places about the joint are tried, from the floor or as the base is tilted; the fewest are
    taken from which the groove is reached all round, clear of everything, with overlaps to stitch
    by. The job is simulated as it stands: see its picture, try it, then make it your cell's.

    Parameters
    ----------
    joint
        The joint's file.
    arm
        Model of the arm: ur5e, ur10e, ur16e, ur20, ur30, kr5_arc, irb1600_10_145, m10ia, or the
        path of a URDF.
    template
        A scan job whose laser, its mount, tool and margins are taken; the example ur10e if left
        out. Each of its keys is an option, too.
    tilt_deg
        Of the base, towards the joint: 0 stands on a pedestal, 180 hangs.
    direction
        Which way round the groove, seen from above the brace.
    carrier
        A file with the table [carrier] of a track, gantry or turn-table: the arm, or the joint, is
        only where that brings it, with the fewest moves, and one scan goes all round.
    out
        The job file to write; ``JOINT-ARM.toml`` if left out. What is there is never overwritten.
    """
    import numpy as np
    import tomli_w

    from tjscan.core.config import read_toml, validate_table
    from tjscan.core.files import write_files_atomically
    from tjscan.job.examples import files_of_example
    from tjscan.job.files import CarrierFile
    from tjscan.result.picture import write_png
    from tjscan.runs.place.job import place_joint
    from tjscan.runs.place.picture import draw_placed_joint
    from tjscan.scanning.target import ScanDirection

    file = out or Path(f"{joint.stem}-{Path(arm).stem}.toml")
    picture = file.with_suffix(".png")
    if file.suffix != ".toml":
        raise ConfigurationError("a job's name ends with .toml", file=file)
    if not -180 <= tilt_deg <= 180:
        raise ConfigurationError("--tilt-deg is between -180 and 180")
    if carrier is not None and tilt_deg:
        raise ConfigurationError("the [carrier] table tilts the base: leave --tilt-deg out")
    for there in (file, picture):
        if there.exists():
            raise ConfigurationError("is there already; choose another with --out", file=there)
    if Path(arm).suffix == ".urdf":  # the template names another folder's
        arm = str(Path(arm).absolute())
    keys = parse_overrides(overrides) | {"arm.model": arm}
    carried = None
    if carrier is not None:
        carried = validate_table(CarrierFile, read_toml(carrier), carrier).carrier
    with TemporaryDirectory() as name:
        if template is None:
            for given, text in files_of_example("ur10e").items():
                (Path(name) / given).write_text(text, encoding="utf-8")
            template = Path(name) / "ur10e.toml"
        way, tilt = ScanDirection(direction), float(np.radians(tilt_deg))
        placed = place_joint(
            joint, template, file.parent, keys, tilt=tilt, direction=way, carrier=carried
        )
    with write_files_atomically(file.parent) as draft:
        (draft / file.name).write_text(tomli_w.dumps(placed.table), encoding="utf-8")
        write_png(draft / picture.name, draw_placed_joint(placed))
    step = 360 / len(placed.azimuths)
    print_table(
        [
            (
                f"place-{n}",
                f"base at {', '.join(f'{1e3 * x:.0f}' for x in arc.T_w_b[:3, 3])} mm; "
                f"{step * (arc.count - 1):.0f}° of the groove from "
                f"{np.degrees(placed.azimuths[arc.first % len(placed.azimuths)]):.0f}°",
            )
            for n, arc in enumerate(placed.stations, 1)
        ]
    )
    print_message(
        f"wrote {file} and {picture}: simulated scans from there read the groove all round. "
        f"Try it: tjscan scan {file}"
    )
