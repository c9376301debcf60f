"""What ``tjscan calibrate`` prints."""

from __future__ import annotations

from rich.table import Table

from tjscan.calibration.file import BallEntry, ResidualEntry, SavedCalibration
from tjscan.cli.output.console import add_text_row, print_message, stderr
from tjscan.report.write import write_run_report
from tjscan.result.directory import CALIBRATION_PICTURE


def finish_calibration(done: SavedCalibration, *, json: bool) -> None:
    """Write page and picture of a calibration, and print it on stderr, as JSON on stdout if asked.

    Raises
    ------
    RecordingError
        If page and picture can't be written.
    """
    page = write_run_report(done.file.parent)
    found = done.calibration
    table = Table(box=None, pad_edge=False)
    for name in ("", "used", "offset mm", "tilt °", "residual σ", "shifts the sensor by mm"):
        table.add_column(name, justify="right" if name else "left")
    for residual in found.residuals:
        add_text_row(table, *_row(residual))
    stderr.print(table)
    print_message("")
    for row in found.sensor_rows:
        print_message("  ".join(f"{value:10.4f}" for value in row))
    print_message(
        f"standard uncertainty {found.sigma_position_mm:.3f} mm and "
        f"{found.sigma_rotation_deg:.4f}° (RMS), from {found.lines} lines, "
        f"{found.method}, condition number {found.condition:.1f}"
    )
    if found.T_b_s_mm is not None:
        print_message("the sensor stands fixed in the room: this is its pose in the arm's base")
    if found.ball is not None:
        print_message(_ball(found.ball))
    for caveat in done.caveats:
        print_message(f"warning: {caveat}")
    print_message(f"written to {done.file}; on a page: {page.name}, {CALIBRATION_PICTURE}")
    if json:
        print(found.model_dump_json(indent=2))


def _ball(ball: BallEntry) -> str:
    stated = ball.stated_radius_mm
    return (
        f"radius of the ball as the arcs show it {ball.measured_radius_mm:.3f} mm "
        f"± {ball.sigma_radius_mm:.3f} mm"
        + ("" if stated is None else f"; stated {stated:.3f} mm, which agrees")
    )


def _row(residual: ResidualEntry) -> tuple[str, ...]:
    return (
        residual.name,
        "yes" if residual.used else "BAD",
        f"{residual.offset_mm:+.3f}",
        "" if residual.tilt_deg is None else f"{residual.tilt_deg:+.3f}",
        f"{residual.misfit:.1f}",
        f"{residual.shift_mm:.3f}",
    )
