"""``tjscan reprocess``."""

from __future__ import annotations

from pathlib import Path

from tjscan.cli.options.overrides import JobKeys, parse_overrides


def reprocess(
    run: Path,
    *overrides: JobKeys,
    out: Path | None = None,
    json: bool = False,
) -> None:
    """Read a run's recorded profiles again with other settings, into a new directory.

    Keys of the job for reading profiles are options: ``--groove.noise-mm 0.1``; so is
    ``--calibration.file``. The run itself stays as it is.

    Parameters
    ----------
    run
        The run directory, whole or cut short, of one station or of several.
    out
        The directory to make; ``RUN-DATE`` beside the run if left out.
    json
        Print the summary as JSON on stdout.
    """
    from tjscan.cli.output.console import print_message, show_phase

    keys = parse_overrides(overrides)
    with show_phase("reading the profiles again"):
        from tjscan.cli.output.scan import print_scan_summary, print_stitched_groove
        from tjscan.report.write import write_run_report
        from tjscan.runs.scan.reprocess import reprocess_run as read_again

        done = read_again(run, keys, out, write_run_report)
    for one in done.stations:
        for index, error in one.lost.items():
            print_message(f"section {index}: {error}")
        for damage in one.damages:
            print_message(str(damage))
    if done.stitched is not None:
        print_stitched_groove(done.stitched, done.directory, json=json)
        return
    for one in done.stations:
        print_scan_summary(one.summary, one.directory, json=json)
    if not all(one.is_whole for one in done.stations):
        raise SystemExit(1)
