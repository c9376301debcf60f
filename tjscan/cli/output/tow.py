"""Output of the tow commands: progress and tables on stderr, JSON on stdout."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from tjscan.cli.interrupt import ctrl_c_presser
from tjscan.cli.options.shared import LiveOptions
from tjscan.cli.output.console import print_fields, print_json, print_message, stderr
from tjscan.core.config import add_file_to_errors
from tjscan.job.tow.cell import check_seam, make_shape_planner
from tjscan.job.tow.job import TowJob
from tjscan.recording.journal import CombinedJournal, RunEvent
from tjscan.report.write import write_run_report
from tjscan.runs.tow.results import TOW_KEY_FIGURES_FILE, key_figures_in_words, read_tow_key_figures
from tjscan.runs.tow.run import TowContext
from tjscan.towing.journal import TowCycle
from tjscan.towing.seam import Seam


class TowProgress:
    """A tow's journal that prints events, and shows how far the welder is.

    Parameters
    ----------
    progress : Progress
        Running.
    task : TaskID
        Whose total is the whole seam, or the whole time, in steps of 1.
    """

    def __init__(self, progress: Progress, task: TaskID) -> None:
        self._progress, self._task = progress, task
        self._first: float | None = None

    def record(self, message: object) -> None:
        """Show how far it is, or print an event."""
        match message:
            case TowCycle(time=time, along=along):
                if self._first is None:
                    self._first = time
                self._progress.update(self._task, completed=1e3 * along or time - self._first)
            case RunEvent(name, detail):
                print_message(f"{name}: {detail}")


@contextmanager
def watch_tow(job: TowJob, file: Path, page: LiveOptions) -> Iterator[TowContext]:
    """Print a tow's events and how far it is, and write its report, while the block runs.

    Parameters
    ----------
    job : TowJob
    file : Path
        The file that it was read from.
    page : LiveOptions
        Whether it is shown in a browser too.
    """
    seam = Seam(job.seam)
    unit = "mm of seam" if seam.length else "s"
    count = TextColumn("{task.completed:.0f} of {task.total:.0f} " + unit)
    columns = TextColumn("{task.description}"), BarColumn(), count, TimeElapsedColumn()
    with Progress(*columns, console=stderr) as progress:
        task = progress.add_task("towing", total=1e3 * seam.length or seam.seconds)
        context = TowContext(job, file, TowProgress(progress, task), write_run_report)
        if not page.live:
            yield context
            return
        from tjscan.runs.live.tow import show_planned, show_tow

        with show_tow(job, file.stem, page.page_address, print_message, ctrl_c_presser()) as shown:
            both = CombinedJournal(context.journal, shown)
            planned = partial(show_planned, shown)
            yield replace(context, journal=both, show_truth=shown.record, show_planned=planned)


def print_seam_feasibility(job: TowJob, file: Path, *, json: bool) -> None:
    """Report whether the cable can follow along the whole seam.

    Raises
    ------
    ConfigurationError
        If it can't, with where and why.
    """
    with add_file_to_errors(file):
        sweep = check_seam(job, make_shape_planner(job))
        sweep.refuse_if_blocked()
    bend = max(abs(plan.angles).max() for plan in sweep.plans)
    if json:
        line = 1e3 * job.chain.line(sweep.start.angles)
        shape = {
            "first_shape": sweep.chosen,
            "first_shapes": sweep.shapes,
            "shape_mm": line.round(1).tolist(),
            "objective": sweep.start.terms.paper,
        }
        print_json(
            {"feasible": True, "length_mm": 1e3 * sweep.length, "bend_rad": float(bend)} | shape
        )
        return
    limit = job.chain.joint_limit
    if sweep.chosen > 1:
        print_message(
            f"{file}: shape {sweep.chosen} of {sweep.shapes} to begin with is taken: from the "
            "better ones the cable gets stuck"
        )
    print_message(
        f"{file}: the cable can follow along the whole seam, {1e3 * sweep.length:.0f} mm; joints "
        f"bend by {57.2958 * bend:.0f}° at most, and {57.2958 * limit:.0f}° are allowed"
    )


def print_tow_key_figures(directory: Path, *, json: bool) -> None:
    """Print the figures of a run."""
    figures = read_tow_key_figures(directory)
    if json:
        print_json({"directory": str(directory), "figures": figures})
        return
    rows = key_figures_in_words(figures)
    print_fields(rows, ("figure", "value"), str(directory / TOW_KEY_FIGURES_FILE))
