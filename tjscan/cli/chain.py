"""``tjscan chain``."""

from __future__ import annotations

from pathlib import Path


def chain(
    chain: Path,
    *,
    arm: bool = True,
    sources: bool = True,
    out: Path | None = None,
    json: bool = False,
) -> None:
    """Calibrate, scan, stitch and compare in simulation, and show where the error comes from.

    Parameters
    ----------
    chain
        The chain's file (TOML): the two jobs of a simulated cell and what it errs by.
    arm
        Calibrate the arm with the sensor.
    sources
        Run the chain again with each source of error alone, and with none.
    out
        The directory to make; ``runs/CHAIN-DATE`` if left out.
    json
        Print the table as JSON on stdout.
    """
    from tjscan.cli.output.chain import one_line, print_sources
    from tjscan.cli.output.console import print_message
    from tjscan.report.write import write_run_report
    from tjscan.result.directory import CALIBRATION_FILE
    from tjscan.runs.chain import CALIBRATION_RUN, read_chain, run_sources
    from tjscan.runs.run import default_run_directory

    read = read_chain(chain)
    directory = out or default_run_directory(chain)
    rows = []
    for row in run_sources(read, directory, arm=arm, begin=print_message, alone=sources):
        rows.append(row)
        print_message(one_line(row))
        calibration = row.directory / CALIBRATION_RUN
        if (calibration / CALIBRATION_FILE).exists():
            print_message(f"  its calibration on a page: {write_run_report(calibration)}")
    print_sources(rows, json=json)
