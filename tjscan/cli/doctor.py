"""``tjscan doctor``."""

from __future__ import annotations

from pathlib import Path

from tjscan.cli.options.overrides import JobKeys, parse_overrides


def doctor(
    job: Path,
    *overrides: JobKeys,
    station: str | None = None,
    json: bool = False,
) -> None:
    """Check a job's cell: files, arm, laser, and the way to its start poses. Nothing moves.

    Parameters
    ----------
    job
        The job file (TOML).
    station
        Station of the arm, if the job has several.
    json
        Print the findings as JSON on stdout.
    """
    from json import dumps

    from tjscan.cli import exit_code_of_error
    from tjscan.runs.doctor import check_job_and_cell

    findings = []
    for finding in check_job_and_cell(job, parse_overrides(overrides), station):
        findings.append(finding)
        if not json:
            mark = "ok   " if finding.passed else "WRONG"
            print(f"{mark} {finding.what}: {' '.join(finding.detail.split())}", flush=True)
    if json:
        rows = [{"what": f.what, "sound": f.passed, "detail": f.detail} for f in findings]
        print(dumps(rows, indent=2))
    codes = {exit_code_of_error(finding.error) for finding in findings if finding.error is not None}
    # A configuration comes first: nothing runs before it is right.
    raise SystemExit(2 if 2 in codes else max(codes, default=0))
