"""What ``tjscan calibrate`` prints."""

from __future__ import annotations

from rich.table import Table

from tjscan.calibration.file import ResidualEntry, SavedCalibration
from tjscan.cli.console import add_text_row, print_message, stderr


def print_calibration(done: SavedCalibration, *, json: bool) -> None:
    """Print a calibration on stderr, and as JSON on stdout if asked."""
    found = done.calibration
    table = Table(box=None, pad_edge=False)
    for name in ("", "used", "offset mm", "tilt °", "residual σ", "shifts the sensor by mm"):
        table.add_column(name, justify="right" if name else "left")
    for residual in found.residuals:
        add_text_row(table, *_row(residual))
    stderr.print(table)
    print_message("")
    for row in found.T_f_s_mm:
        print_message("  ".join(f"{value:10.4f}" for value in row))
    print_message(
        f"standard uncertainty {found.sigma_position_mm:.3f} mm and "
        f"{found.sigma_rotation_deg:.4f}° (RMS), from {found.lines} lines, "
        f"{found.method}, condition number {found.condition:.1f}"
    )
    for caveat in done.caveats:
        print_message(f"warning: {caveat}")
    print_message(f"written to {done.file}")
    if json:
        print(found.model_dump_json(indent=2))


def _row(residual: ResidualEntry) -> tuple[str, ...]:
    return (
        residual.name,
        "yes" if residual.used else "BAD",
        f"{residual.offset_mm:+.3f}",
        "" if residual.tilt_deg is None else f"{residual.tilt_deg:+.3f}",
        f"{residual.misfit:.1f}",
        f"{residual.shift_mm:.3f}",
    )
