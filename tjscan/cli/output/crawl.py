"""Output of the crawl commands: progress and tables on stderr, JSON on stdout."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from math import isfinite
from pathlib import Path

from tjscan.cli.interrupt import ctrl_c_presser
from tjscan.cli.options.shared import LiveCrawlOptions
from tjscan.cli.output.console import print_fields, print_json, print_message
from tjscan.crawler.sizing import SizeFigure
from tjscan.crawler.slip_calibration import SlipCalibration
from tjscan.job.crawl.job import CrawlJob
from tjscan.recording.journal import CombinedJournal, RunEvent
from tjscan.report.write import write_run_report
from tjscan.runs.crawl.results import PASSES_FILE, read_passes
from tjscan.runs.crawl.run import AutomaticWeldOperator, CrawlContext


class EventPrinter:
    """A crawl's journal that prints its events."""

    def record(self, message: object) -> None:
        """Print an event; there are a hundred cycles a second."""
        if isinstance(message, RunEvent):
            print_message(f"{message.name}: {message.detail}")


class TerminalWeldOperator:
    """A `WeldOperator` who is asked at the terminal before each pass."""

    def confirm_weld(self, number: int) -> bool:
        """Ask until it is confirmed; Ctrl-C stops the crawler instead."""
        import questionary

        question = f"Gas, wire and current ready, and the way clear of people: weld pass {number}?"
        return bool(questionary.confirm(question).unsafe_ask())


@contextmanager
def watch_crawl(
    job: CrawlJob, file: Path, page: LiveCrawlOptions | None = None
) -> Iterator[CrawlContext]:
    """Print a crawl's events, and write its report, while the block runs.

    Parameters
    ----------
    job : CrawlJob
    file : Path
        The file that it was read from.
    page : LiveCrawlOptions, optional
        Whether it is shown in a browser too, and driven by hand there before it begins.
    """
    operator = TerminalWeldOperator() if job.simulation is None else AutomaticWeldOperator()
    context = CrawlContext(job, file, EventPrinter(), write_run_report, operator)
    if page is None or not page.live:
        yield context
        return
    from tjscan.runs.live.crawl import PageHandDrive, show_crawl

    hand, stop = PageHandDrive.of_job(job) if page.wait else None, ctrl_c_presser()
    with show_crawl(job, file.stem, page.page_address, print_message, stop, hand) as shown:
        both = CombinedJournal(context.journal, shown)
        yield replace(context, journal=both, hand=hand)


def print_passes(directory: Path, *, json: bool) -> None:
    """Print the passes of a run."""
    rows = read_passes(directory)
    if json:
        print_json({"directory": str(directory), "passes": rows})
        return
    _print_pass_rows(rows, f"{directory / PASSES_FILE}")


def print_comparison(runs: Mapping[str, Sequence[Mapping[str, str]]], *, json: bool) -> None:
    """Print the passes of several runs below one another."""
    if json:
        print_json(runs)
        return
    for name, rows in runs.items():
        _print_pass_rows(rows, name)


def print_crawler_sizing(figures: Sequence[SizeFigure], *, json: bool) -> None:
    """Print the figures of a sizing, and which rules are broken."""
    if json:
        names = ("name", "value", "unit", "least", "most", "holds", "advice")
        rows = [{name: getattr(one, name) for name in names} for one in figures]
        for row in rows:
            row["value"] = row["value"] if isfinite(row["value"]) else None
        print_json(rows)
        return
    cells = []
    for one in figures:
        state = "" if not one.rule else "holds" if one.holds else "BROKEN"
        cells.append((one.name, f"{one.value:.4g} {one.unit}", one.rule, state))
    print_fields(cells, ("figure", "value", "rule", ""))
    for one in figures:
        if not one.holds:
            print_message(f"{one.name} is {one.value:.3g} {one.unit}".rstrip() + f": {one.advice}")


def print_slip_calibration(found: SlipCalibration, directory: Path, *, json: bool) -> None:
    """Print what a shuttle learned, with standard deviations."""
    if json:
        print(found.model_dump_json(indent=2))
        return
    print_fields(found.rows, ("quantity", "value", "standard deviation"))
    print_message(
        f'a job takes it with: calibration = "{directory.resolve() / "calibration.toml"}"'
    )


def _print_pass_rows(rows: Sequence[Mapping[str, str]], title: str) -> None:
    if not rows:
        print_message(f"{title}: no pass was welded")
        return
    # Quantities go down and passes across: a terminal is not as wide as the file.
    head = ("", *(f"pass {row['pass']}" for row in rows))
    print_fields([(name, *(row[name] for row in rows)) for name in list(rows[0])[1:]], head, title)
