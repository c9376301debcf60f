"""``tjscan accept``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tjscan.cli.options.shared import JobKeys, parse_overrides

if TYPE_CHECKING:
    from tjscan.runs.accept.judge import AcceptanceRow


def accept(
    job: Path,
    *overrides: JobKeys,
    station: str | None = None,
    out: Path | None = None,
    against: Path | None = None,
    unattended: bool = False,
    json: bool = False,
) -> None:
    """Measure a cell at a certified ball, against what its job states; the same as monthly check.

    Exit code 0 if every row passes, 1 if one does not, or has drifted.

    Parameters
    ----------
    job
        The job file (TOML) of the cell, with the tables ``[ball]`` and ``[artefact]``. Each of its
        keys is an option, too.
    station
        The station of the arm, of a job with several stations.
    out
        The directory to make; ``runs/JOB-DATE`` if left out.
    against
        An earlier acceptance, or a folder of them, of which the first counts: how far each row has
        drifted since.
    unattended
        Ask nothing; for a simulated cell.
    json
        Print the record as JSON on stdout.
    """
    from tjscan.core.config import add_file_to_errors
    from tjscan.job.files import read_acceptance_job

    with add_file_to_errors(job):
        parsed = read_acceptance_job(job, parse_overrides(overrides)).job_at_station(station)
    # A job with a mistake in it is refused before anything heavy is loaded.
    from tjscan.cli.output.calibration import PrintOnlyOperator, TerminalOperator
    from tjscan.cli.output.console import print_figures_table, print_message
    from tjscan.result.directory import default_run_directory
    from tjscan.runs.accept.run import ACCEPTANCE_FILE, accept_cell, read_earlier_acceptance

    directory = out or default_run_directory(job)
    with add_file_to_errors(job):
        earlier = None if against is None else read_earlier_acceptance(against, parsed)
        operator = PrintOnlyOperator() if unattended else TerminalOperator()
        found = accept_cell(parsed, job, directory, operator, earlier)
    head = ("", "measured", "±", "should be", "limit", "", "drift σ")
    shown = len(head) if against is not None else -1  # nothing has drifted since nothing
    print_figures_table(head[:shown], [_cells(row)[:shown] for row in found.rows])
    for row in found.rows:
        if row.limit is not None and not row.passes:
            print_message(f"{row.what}: the limit is from {row.source}")
        if row.has_drifted:
            print_message(f"{row.key}: {row.what} has drifted since {found.against}")
    print_message(f"{'accepted' if found.passes else 'NOT accepted'}; the record is in {directory}")
    if json:
        print((directory / ACCEPTANCE_FILE).read_text(encoding="utf-8"))
    if not found.passes:
        raise SystemExit(1)


def _cells(row: AcceptanceRow) -> tuple[str, ...]:
    """A row's cells; what is only compared has neither nominal nor limit."""
    cells = row.what, f"{row.measured:.3f} {row.unit}", f"{row.sigma:.3f}"
    drift = "" if row.drift is None else f"{row.drift:+.1f}"
    if row.limit is None:
        return (*cells, "", "", "", drift)
    passes = "passes" if row.passes else "FAILS"
    return (*cells, f"{row.nominal:.3f}", f"{row.limit:.3f}", passes, drift)
